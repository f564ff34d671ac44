#include "engine/map_alignment.h"

#include <algorithm>
#include <map>
#include <numeric>

#include "absl/strings/str_join.h"
#include "base/median.h"
#include "engine/alignment_target.h"

namespace cairn::engine {

absl::StatusOr<std::vector<AlignmentTarget>> TargetsOf(const std::string& map, const map::Snapshot& snapshot,
                                                       const api::AlignRequest& request) {
  if (request.session && !snapshot.sessions().contains(request.session)) {
    return absl::NotFoundError(absl::StrCat(map, " has no session ", request.session.value(), " (cairn info)"));
  }
  struct Taken {
    TimeNs time_ns;
    KeyframeId id;
  };
  std::map<ComponentId, std::vector<Taken>> taken;
  for (const ComponentId id : snapshot.LiveComponents()) taken[id] = {};
  snapshot.keyframes().ForEach([&](const auto& keyframe) {
    if (request.session && keyframe->session != request.session) return;
    taken[keyframe->component].push_back({keyframe->time_ns, keyframe->id});
  });
  std::vector<AlignmentTarget> targets;
  for (auto& [id, keyframes] : taken) {
    std::ranges::stable_sort(keyframes, {}, &Taken::time_ns);
    AlignmentTarget target{id, snapshot.WorldFrom(id), {}, {}, {}};
    for (const Taken& keyframe : keyframes) {
      target.keyframes.push_back({keyframe.time_ns, snapshot.keyframe(keyframe.id).camera_from_map.Inverse()});
      target.ids.push_back(keyframe.id);
    }
    targets.push_back(std::move(target));
  }
  return targets;
}

absl::StatusOr<std::size_t> ChooseTarget(const std::string& map, const std::vector<AlignmentTarget>& targets,
                                         const api::AlignRequest& request) {
  if (targets.empty()) return absl::FailedPreconditionError(absl::StrCat(map, " has no keyframes"));
  if (!request.component) {
    const auto most = std::max_element(
        targets.begin(), targets.end(),
        [](const AlignmentTarget& x, const AlignmentTarget& y) { return x.pairs.size() < y.pairs.size(); });
    return static_cast<std::size_t>(most - targets.begin());
  }
  std::vector<ComponentId::Value> there;
  for (std::size_t i = 0; i < targets.size(); ++i) {
    if (targets[i].component == request.component) return i;
    there.push_back(targets[i].component.value());
  }
  return absl::NotFoundError(absl::StrCat(map, " has no component ", request.component.value(), "; there is ",
                                          absl::StrJoin(there, ", "), " (cairn info)"));
}

std::vector<api::ComponentAlignment::Other> OthersOf(const std::vector<AlignmentTarget>& targets, std::size_t chosen) {
  std::vector<api::ComponentAlignment::Other> others;
  for (std::size_t i = 0; i < targets.size(); ++i) {
    if (i == chosen) continue;
    others.push_back({targets[i].component, static_cast<std::int64_t>(targets[i].keyframes.size()),
                      static_cast<std::int64_t>(targets[i].pairs.size()), targets[i].world_from_component.has_value()});
  }
  return others;
}

std::optional<double> MedianMove(const AlignmentTarget& target, const Sim3& world_from_component) {
  if (!target.world_from_component) return std::nullopt;
  std::vector<double> moves;
  for (const StampedPose& keyframe : target.keyframes) {
    const Vector3d& center = keyframe.world_from_camera.translation();
    moves.push_back((world_from_component * center - *target.world_from_component * center).norm());
  }
  return Median(std::move(moves));
}

void PutAlignment(ComponentId id, const Sim3& world_from_component, map::Edit* edit) {
  map::Component component = edit->component(id);
  component.world_from_component = world_from_component;
  edit->PutComponent(component);
}

namespace {

absl::Status SetAnchor(const std::string& map, const std::optional<map::GeoAnchor>& anchor,
                       const api::AlignRequest& request, map::Edit* edit) {
  const map::Snapshot& base = edit->base();
  if (anchor && base.info().geo_anchor && !request.overwrite) {
    return absl::AlreadyExistsError(
        absl::StrCat(map, " has a geographic anchor already: ask to overwrite it (--overwrite)"));
  }
  const bool aligned = std::ranges::any_of(
      base.LiveComponents(), [&](ComponentId component) { return base.WorldFrom(component).has_value(); });
  if (anchor && !aligned) {
    return absl::FailedPreconditionError(absl::StrCat(
        map,
        " is not aligned to the world yet, so that its origin is nowhere: align it first (--groundtruth), or give "
        "the geographic positions of keyframes (--geo-positions)"));
  }
  map::MapInfo info = edit->info();
  info.geo_anchor = anchor;
  edit->SetInfo(info);
  return absl::OkStatus();
}

// What is to be stored, with the reason for the log.
struct Made {
  std::optional<api::ComponentAlignment> component;
  std::string reason;
};

absl::StatusOr<Made> Aligned(absl::StatusOr<api::ComponentAlignment> aligned, absl::string_view how) {
  CAIRN_RETURN_IF_ERROR(aligned.status());
  const auto id = aligned->component.value();
  return Made{*std::move(aligned), absl::StrCat("align component ", id, " ", how)};
}

absl::StatusOr<Made> Make(const std::string& map, const api::AlignRequest& request, map::Edit* edit) {
  if (const auto* anchor = std::get_if<map::GeoAnchor>(&request.by)) {
    CAIRN_RETURN_IF_ERROR(SetAnchor(map, *anchor, request, edit));
    return Made{std::nullopt, "set the geographic anchor"};
  }
  if (std::holds_alternative<api::NoGeoAnchor>(request.by)) {
    CAIRN_RETURN_IF_ERROR(SetAnchor(map, std::nullopt, request, edit));
    return Made{std::nullopt, "remove the geographic anchor"};
  }
  if (std::holds_alternative<api::KnownPlaces>(request.by)) {
    return Aligned(AlignByPlaces(map, request, edit), "by known places");
  }
  return std::holds_alternative<api::ReferencePoses>(request.by)
             ? Aligned(AlignByPoses(map, request, edit), "to the world")
             : Aligned(AlignByPositions(map, request, edit), "by geographic positions");
}

bool Same(const std::optional<map::GeoAnchor>& a, const std::optional<map::GeoAnchor>& b) {
  if (!a || !b) return a.has_value() == b.has_value();
  return a->latitude_deg == b->latitude_deg && a->longitude_deg == b->longitude_deg && a->height_m == b->height_m &&
         a->enu_from_world.coeffs() == b->enu_from_world.coeffs();
}

}  // namespace

absl::StatusOr<api::AlignAnswer> AlignMap(const std::string& map, const api::AlignRequest& request, LiveMap& live) {
  CAIRN_RETURN_IF_ERROR(request.Validate());
  api::AlignAnswer answer;
  {
    // Nobody else changes the map between what is computed and what is stored.
    LiveMap::Editor editor = live.BeginEdit();
    const std::shared_ptr<const map::Snapshot> head = editor.View()->snapshot();
    map::Edit edit(head);
    CAIRN_ASSIGN_OR_RETURN(Made made, Make(map, request, &edit));
    answer.component = std::move(made.component);
    answer.geo_anchor = edit.info().geo_anchor;
    answer.geo_anchor_changed = !Same(answer.geo_anchor, head->info().geo_anchor);
    CAIRN_RETURN_IF_ERROR(editor.Commit(edit.Finish(made.reason), {}));
    answer.revision = editor.View()->revision();
  }
  CAIRN_RETURN_IF_ERROR(live.Flush());
  return answer;
}

}  // namespace cairn::engine

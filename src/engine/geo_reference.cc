// Aligning a component by where its keyframes were on the earth.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "absl/strings/str_format.h"
#include "engine/alignment_target.h"
#include "geometry/alignment.h"
#include "map/geo_pose.h"

namespace cairn::engine {
namespace {

constexpr double kDegPerRad = 180.0 / std::numbers::pi;

using Positions = std::vector<api::GeoPositions::At>;

// The keyframe that a position is of, as an index into the target's: the named one, or the nearest in time.
std::optional<std::size_t> KeyframeOf(const api::GeoPositions::At& at, const AlignmentTarget& target, double max_dt_s) {
  if (at.keyframe) {
    const auto found = std::ranges::find(target.ids, at.keyframe);
    if (found == target.ids.end()) return std::nullopt;
    return static_cast<std::size_t>(found - target.ids.begin());
  }
  const StampedPose asked{at.time_ns, {}};
  const std::vector<Association> nearest = AssociateNearest({&asked, 1}, target.keyframes, max_dt_s);
  if (nearest.empty()) return std::nullopt;
  return nearest[0].groundtruth;
}

void Associate(const Positions& positions, double max_dt_s, AlignmentTarget* target) {
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (const auto keyframe = KeyframeOf(positions[i], *target, max_dt_s)) target->pairs.push_back({*keyframe, i});
  }
}

absl::Status CheckKeyframes(const std::string& map, const map::Snapshot& snapshot, const Positions& positions) {
  for (const api::GeoPositions::At& at : positions) {
    if (at.keyframe && snapshot.keyframes().Find(at.keyframe) == nullptr) {
      return absl::NotFoundError(absl::StrCat(map, " has no keyframe ", at.keyframe.value()));
    }
  }
  return absl::OkStatus();
}

// Positions in metres and in the frame of the map, or of the world where that has its scale already.
struct Pairs {
  std::vector<Vector3d> enu, map;
};

Pairs PairsOf(const Positions& positions, const AlignmentTarget& target, const GeoPosition& origin) {
  Pairs pairs;
  for (const Association& pair : target.pairs) {
    const Vector3d center = target.keyframes[pair.estimate].world_from_camera.translation();
    pairs.enu.push_back(EnuFromGeodetic(positions[pair.groundtruth].position, origin));
    pairs.map.push_back(target.world_from_component ? *target.world_from_component * center : center);
  }
  return pairs;
}

// Whether the positions leave nothing open. With --force only what they cannot say at all is refused.
absl::Status Judge(const Alignment& found, const AlignmentTarget& target, const api::AlignRequest& request) {
  constexpr double kMaxScaleSigma = 0.1, kMaxRotationSigmaRad = 5.0 / kDegPerRad;
  const double scale_sigma = found.scale_sigma / found.a_from_b.scale();
  if (request.force || (scale_sigma <= kMaxScaleSigma && found.rotation_sigma_rad <= kMaxRotationSigmaRad)) {
    return absl::OkStatus();
  }
  return absl::FailedPreconditionError(absl::StrFormat(
      "%s does not align component %u; the map is as it was: the positions differ by %.2f m (RMSE) from the keyframes, "
      "so that the scale is uncertain by %.0f %% and the rotation by %.1f deg. Are they of this recording, with its "
      "clock? More of them, and further apart, help; --force aligns to them all the same.",
      request.source, target.component.value(), found.rmse, 100.0 * scale_sigma,
      found.rotation_sigma_rad * kDegPerRad));
}

absl::StatusOr<Alignment> Solve(const Pairs& pairs, const AlignmentTarget& target, const api::AlignRequest& request) {
  AlignmentOptions options;
  options.with_scale = !target.world_from_component.has_value();
  options.min_spread_ratio = 0.02;  // less than what positions err says nothing of the rotation about the line
  absl::StatusOr<Alignment> found = AlignPoints(pairs.enu, pairs.map, options);
  if (!found.ok()) {
    return Annotate(found.status(), absl::StrCat(target.pairs.size(), " of the positions in ", request.source,
                                                 " are of keyframes of component ", target.component.value(),
                                                 " (within ", request.max_dt_s, " s, --max-dt)"));
  }
  CAIRN_RETURN_IF_ERROR(Judge(*found, target, request));
  return found;
}

bool AnythingIsAligned(const std::vector<AlignmentTarget>& targets) {
  return std::ranges::any_of(targets, [](const AlignmentTarget& t) { return t.world_from_component.has_value(); });
}

void PutAnchor(const map::GeoAnchor& anchor, map::Edit* edit) {
  map::MapInfo info = edit->info();
  info.geo_anchor = anchor;
  edit->SetInfo(info);
}

// The world of an aligned map found where enu_from_world says, measured at `origin`.
map::GeoAnchor AnchorFrom(const Sim3& enu_from_world, const GeoPosition& origin) {
  const GeoPosition world_origin = GeodeticFromEnu(enu_from_world.translation(), origin);
  return map::AnchorAt(world_origin, EnuAtFromEnu(world_origin, origin) * enu_from_world.rotation());
}

absl::Status CheckAllowed(const std::string& map, const AlignmentTarget& target,
                          const std::vector<AlignmentTarget>& targets, bool anchored,
                          const api::AlignRequest& request) {
  if (target.world_from_component && anchored && !request.overwrite) {
    return absl::AlreadyExistsError(
        absl::StrCat("component ", target.component.value(), " of ", map,
                     " is aligned, and the map has a geographic anchor already: ask to overwrite that (--overwrite)"));
  }
  if (!target.world_from_component && !anchored && AnythingIsAligned(targets)) {
    return absl::FailedPreconditionError(absl::StrCat(
        "component ", target.component.value(), " of ", map,
        " is not aligned, others are to a world whose place on the earth is not known: give positions of their "
        "keyframes first (--component)"));
  }
  return absl::OkStatus();
}

api::ComponentAlignment Told(const Alignment& found, const Pairs& pairs, const AlignmentTarget& target) {
  api::ComponentAlignment told;
  told.component = target.component;
  told.keyframes = static_cast<std::int64_t>(target.keyframes.size());
  told.with_reference = told.fitting = static_cast<std::int64_t>(target.pairs.size());
  told.rmse_fitting_m = told.rmse_all_m = found.rmse;
  told.scale_sigma = found.scale_sigma;
  told.rotation_sigma_rad = found.rotation_sigma_rad;
  const double degrees_of_freedom = 3.0 * static_cast<double>(pairs.enu.size()) - 7.0;
  const double per_axis =
      found.rmse * std::sqrt(static_cast<double>(pairs.enu.size()) / std::max(1.0, degrees_of_freedom));
  told.noise_position_m = per_axis;
  told.position_sigma_m = per_axis / std::sqrt(static_cast<double>(pairs.enu.size()));
  return told;
}

}  // namespace

absl::StatusOr<api::ComponentAlignment> AlignByPositions(const std::string& map, const api::AlignRequest& request,
                                                         map::Edit* edit) {
  const Positions& positions = std::get<api::GeoPositions>(request.by).positions;
  CAIRN_RETURN_IF_ERROR(CheckKeyframes(map, edit->base(), positions));
  CAIRN_ASSIGN_OR_RETURN(std::vector<AlignmentTarget> targets, TargetsOf(map, edit->base(), request));
  for (AlignmentTarget& target : targets) Associate(positions, request.max_dt_s, &target);
  CAIRN_ASSIGN_OR_RETURN(const std::size_t chosen, ChooseTarget(map, targets, request));
  const AlignmentTarget& target = targets[chosen];
  const std::optional<map::GeoAnchor> anchor = edit->info().geo_anchor;
  CAIRN_RETURN_IF_ERROR(CheckAllowed(map, target, targets, anchor.has_value(), request));

  const bool keeps_anchor = anchor && !target.world_from_component;
  const GeoPosition origin = keeps_anchor ? map::PositionOf(*anchor) : positions[0].position;
  const Pairs pairs = PairsOf(positions, target, origin);
  CAIRN_ASSIGN_OR_RETURN(const Alignment found, Solve(pairs, target, request));
  api::ComponentAlignment told = Told(found, pairs, target);
  if (target.world_from_component) {
    told.world_from_component = *target.world_from_component;
    PutAnchor(AnchorFrom(found.a_from_b, origin), edit);
  } else {
    const Sim3 world_from_enu = keeps_anchor ? Sim3(anchor->enu_from_world.conjugate(), Vector3d::Zero(), 1.0) : Sim3();
    told.world_from_component = world_from_enu * found.a_from_b;
    PutAlignment(target.component, told.world_from_component, edit);
    if (!keeps_anchor) PutAnchor(map::AnchorAt(origin, Quaterniond::Identity()), edit);
  }
  told.others = OthersOf(targets, chosen);
  return told;
}

}  // namespace cairn::engine

#include "care/packing.h"

#include <algorithm>
#include <unordered_map>
#include <utility>
#include <vector>

#include "care/whole_map.h"
#include "image/feature.h"
#include "map/edit.h"

namespace cairn::care {
namespace {

// The sightings of a point that are kept: the typical one, and then always the one that is furthest from all kept so
// far; of those, what looks the same is said once.
std::vector<map::Observation> MostTelling(const map::Snapshot& map, const map::MapPoint& point, std::size_t count) {
  std::vector<map::Observation> kept = {point.reference}, left;
  for (const map::Observation& observation : point.observations) {
    if (observation != point.reference) left.push_back(observation);
  }
  const auto descriptor = [&](const map::Observation& o) -> const image::Descriptor& {
    return map.keyframe(o.keyframe).descriptors()[o.feature];
  };
  std::vector<int> nearest;
  for (const map::Observation& o : left) nearest.push_back(image::HammingDistance(point.descriptor, descriptor(o)));
  while (kept.size() < count && !left.empty()) {
    const auto furthest = std::ranges::max_element(nearest) - nearest.begin();
    const map::Observation next = left[static_cast<std::size_t>(furthest)];
    kept.push_back(next);
    left.erase(left.begin() + furthest);
    nearest.erase(nearest.begin() + furthest);
    for (std::size_t i = 0; i < left.size(); ++i) {
      nearest[i] = std::min(nearest[i], image::HammingDistance(descriptor(next), descriptor(left[i])));
    }
  }
  return kept;
}

// Observations that go: those that are not among the most telling ones, of keyframes that have enough without.
void DropSightings(const PackOptions& options, map::Edit* edit) {
  const map::Snapshot& map = edit->base();
  std::unordered_map<KeyframeId, int> points;
  map.keyframes().ForEach([&](const auto& keyframe) {
    points[keyframe->id] =
        static_cast<int>(std::ranges::count_if(keyframe->points, [](PointId id) { return id.valid(); }));
  });
  const auto most = static_cast<std::size_t>(options.max_sightings);
  map.points().ForEach([&](const auto& point) {
    if (point->observations.size() <= most) return;
    const std::vector<map::Observation> kept = MostTelling(map, *point, most);
    for (const map::Observation& observation : point->observations) {
      if (std::ranges::find(kept, observation) != kept.end() || points[observation.keyframe] <= options.min_features) {
        continue;
      }
      --points[observation.keyframe];
      edit->RemoveObservation(point->id, observation.keyframe, 1);
    }
  });
}

// The features of a keyframe that see a point, and where each of the old ones is now.
struct Kept {
  std::shared_ptr<const map::KeyframeFeatures> features;
  std::vector<PointId> points;
  std::vector<std::uint32_t> now;
};

Kept KeepSeen(const map::Keyframe& keyframe) {
  Kept kept;
  auto features = std::make_shared<map::KeyframeFeatures>();
  kept.now.resize(keyframe.points.size());
  for (std::size_t i = 0; i < keyframe.points.size(); ++i) {
    if (!keyframe.points[i]) continue;
    kept.now[i] = static_cast<std::uint32_t>(kept.points.size());
    kept.points.push_back(keyframe.points[i]);
    features->features.keypoints.push_back(keyframe.keypoints()[i]);
    features->features.descriptors.push_back(keyframe.descriptors()[i]);
    if (!keyframe.features->words.empty()) features->words.push_back(keyframe.features->words[i]);
  }
  kept.features = std::move(features);
  return kept;
}

void ForgetHistory(map::Delta* delta) {
  for (map::Session& session : delta->sessions) {
    session.loops.clear();
    session.trajectory.reset();
    session.settings_json = "{}";
  }
}

}  // namespace

absl::Status PackOptions::Validate() const {
  if (max_sightings < 1 || min_features < 0) {
    return absl::InvalidArgumentError("pack: a point needs one sighting at least, and features cannot be negative");
  }
  return absl::OkStatus();
}

absl::StatusOr<Packed> Pack(const map::Snapshot& whole, const map::MapInfo& info, const PackOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  // An edit of a map without history: its revisions do not matter here.
  CAIRN_ASSIGN_OR_RETURN(const auto start, map::Snapshot::Empty(whole.info())->Apply(AsOneChange(whole, "pack")));
  map::Edit edit(start);
  DropSightings(options, &edit);
  CAIRN_ASSIGN_OR_RETURN(const auto map, start->Apply(edit.Finish("pack")));

  Packed packed;
  map::Delta delta = AsOneChange(*map, "pack");
  ForgetHistory(&delta);
  std::unordered_map<KeyframeId, std::vector<std::uint32_t>> now;
  for (auto& keyframe : delta.keyframes) {
    Kept kept = KeepSeen(*keyframe);
    packed.features_before += static_cast<std::int64_t>(keyframe->points.size());
    packed.features_after += static_cast<std::int64_t>(kept.points.size());
    auto small = std::make_shared<map::Keyframe>(*keyframe);
    small->features = std::move(kept.features);
    small->points = std::move(kept.points);
    now.emplace(keyframe->id, std::move(kept.now));
    keyframe = std::move(small);
  }
  for (auto& point : delta.points) {
    auto moved = std::make_shared<map::MapPoint>(*point);
    for (map::Observation& observation : moved->observations) {
      observation.feature = now.at(observation.keyframe)[observation.feature];
    }
    moved->reference.feature = now.at(point->reference.keyframe)[point->reference.feature];
    point = std::move(moved);
  }
  CAIRN_ASSIGN_OR_RETURN(packed.map, map::Snapshot::Empty(info)->Apply(delta));
  return packed;
}

}  // namespace cairn::care

#include "care/adjustment.h"

#include <algorithm>
#include <utility>

#include "geometry/alignment.h"
#include "inspect/measures.h"
#include "map/edit.h"
#include "mapping/full_adjustment.h"

namespace cairn::care {
namespace {

// Takes adjusted cameras back, as a whole, to where they were.
void KeepPlace(const map::Snapshot& map, mapping::FullAdjustment* full) {
  std::vector<Vector3d> before, after;
  for (const auto& [id, camera_from_map] : full->camera_from_map) {
    before.push_back(map.keyframe(id).CenterInMap());
    after.push_back(camera_from_map.Inverse().translation());
  }
  const auto back = AlignPoints(before, after);
  if (!back.ok()) return;  // too few, or on a line: the root holds it
  const Sim3& before_from_after = back->a_from_b;
  for (auto& [id, pose] : full->camera_from_map) pose = RigidPart(Sim3(pose) * before_from_after.Inverse());
  for (auto& [id, position] : full->positions) position = before_from_after * position;
}

void NoteMoves(const map::Snapshot& map, const mapping::FullAdjustment& full, std::vector<double>* moves) {
  for (const auto& [id, camera_from_map] : full.camera_from_map) {
    const map::Keyframe& keyframe = map.keyframe(id);
    const double depth = inspect::MedianDepth(inspect::Measure(map, keyframe));
    if (!(depth > 0.0)) continue;
    moves->push_back((camera_from_map.Inverse().translation() - keyframe.CenterInMap()).norm() / depth);
  }
}

}  // namespace

absl::StatusOr<AdjustedChange> AdjustAfter(const std::shared_ptr<const map::Snapshot>& base, map::Delta change,
                                           const std::vector<ComponentId>& components) {
  AdjustedChange adjusted;
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const map::Snapshot> changed, base->Apply(change));
  map::Edit edit(changed);
  for (const ComponentId component : components) {
    absl::StatusOr<mapping::FullAdjustment> full = mapping::ComputeFullAdjustment(*changed, component);
    if (absl::IsFailedPrecondition(full.status()) || absl::IsInternal(full.status())) continue;
    CAIRN_RETURN_IF_ERROR(full.status());
    if (changed->WorldFrom(component)) KeepPlace(*changed, &*full);
    NoteMoves(*changed, *full, &adjusted.moves);
    adjusted.keyframes += static_cast<std::int64_t>(full->camera_from_map.size());
    adjusted.rmse_px = std::max(adjusted.rmse_px, full->rmse);
    mapping::MergeFullAdjustment(*std::move(full), edit);
  }
  if (adjusted.keyframes == 0) {
    adjusted.delta = std::move(change);
    return adjusted;
  }
  const std::string reason = change.reason;
  CAIRN_ASSIGN_OR_RETURN(adjusted.delta, map::MergeDeltas(*base, change, edit.Finish(reason)));
  adjusted.delta.reason = reason;
  adjusted.delta.num_changes = 1;  // it is made at once
  return adjusted;
}

}  // namespace cairn::care

#include "mapping/local_mapper.h"

#include <algorithm>

#include "mapping/held.h"
#include "mapping/new_points.h"
#include "mapping/point_fusion.h"
#include "mapping/stopwatch.h"

namespace cairn::mapping {
namespace {

// While the map is as young as this every adjustment is a full one with more iterations: everything rests on the start.
constexpr int kStartKeyframes = 6;

}  // namespace

void LocalMapper::CountVisible(std::span<const PointId> visible, std::span<const PointId> found) {
  for (const PointId point : visible) ++visibility_[point].first;
  for (const PointId point : found) {
    if (point) ++visibility_[point].second;
  }
}

void LocalMapper::FlushVisibility(map::Edit& edit) {
  for (const auto& [point, counts] : visibility_) {
    if (edit.FindPoint(point) == nullptr) continue;
    edit.AddVisibility(point, counts.first, counts.second);
    if (IsClutter(edit.point(point), options_)) edit.ErasePoint(point);
  }
  visibility_.clear();
}

absl::StatusOr<InsertionReport> LocalMapper::Insert(map::Edit& edit, InsertionRequest request) {
  InsertionReport report;
  CpuStopwatch watch;
  FlushVisibility(edit);
  report.keyframe = edit.AddKeyframe(std::move(request.keyframe));
  ++inserted_;
  for (std::uint32_t i = 0; i < request.points.size(); ++i) {
    if (request.points[i] && edit.FindPoint(request.points[i]) != nullptr) {
      edit.AddObservation(request.points[i], report.keyframe, i);
    }
  }
  edit.UpdateCovisibility(report.keyframe);
  AddPoints(edit, request, &report);
  report.new_points_ms = watch.LapMs();
  Fuse(edit, request, &report);
  report.fuse_ms = watch.LapMs();
  CAIRN_RETURN_IF_ERROR(Adjust(edit, &report));
  report.adjust_ms = watch.LapMs();
  Cull(edit, &report);
  if (request.parent && edit.FindKeyframe(request.parent) != nullptr) {
    edit.LinkIfAlone(report.keyframe, request.parent);
  }
  report.cull_ms = watch.LapMs();
  return report;
}

void LocalMapper::AddPoints(map::Edit& edit, const InsertionRequest& request, InsertionReport* report) {
  const std::vector<KeyframeId> neighbours =
      SurroundingKeyframes(edit, report->keyframe, options_.triangulation_neighbours, 0, {});
  TriangulationOptions triangulation;
  triangulation.min_parallax_deg = options_.min_parallax_deg;
  triangulation.min_baseline_share = options_.min_baseline_share;
  triangulation.max_chi_square = options_.max_chi_square;
  triangulation.covered_points = options_.covered_points;
  triangulation.covered_age = options_.covered_age;
  std::vector<PointId> added =
      TriangulateWith(edit, report->keyframe, neighbours, request.depths, request.map_per_direct,
                      DepthRangeOf(edit, report->keyframe), triangulation);
  if (request.points_from_depths) {
    const std::vector<PointId> more = PointsFromDepths(edit, report->keyframe, request.depths, request.map_per_direct);
    added.insert(added.end(), more.begin(), more.end());
  }
  culler_.Watch(added, inserted_);
  report->new_points = static_cast<int>(added.size());
  edit.UpdateCovisibility(report->keyframe);
}

void LocalMapper::Fuse(map::Edit& edit, const InsertionRequest& request, InsertionReport* report) {
  const std::vector<KeyframeId> around = SurroundingKeyframes(edit, report->keyframe, options_.fusion_neighbours,
                                                              options_.fusion_second_neighbours, request.nearby);
  FusionOptions fusion;
  fusion.radius_px = options_.fusion_radius_px;
  fusion.max_chi_square = options_.max_chi_square;
  report->fused_points = FuseAround(edit, report->keyframe, around, grids_, fusion).fused;
  edit.UpdateCovisibility(report->keyframe);
}

absl::Status LocalMapper::Adjust(map::Edit& edit, InsertionReport* report) {
  LocalAdjustmentOptions adjustment;
  const bool young = inserted_ <= kStartKeyframes;
  adjustment.first_iterations = options_.first_iterations * (young ? 3 : 1);
  adjustment.second_iterations = options_.second_iterations * (young ? 3 : 1);
  adjustment.max_fixed_keyframes = options_.max_fixed_keyframes;
  const std::vector<KeyframeId> free =
      KeyframesToAdjust(edit, report->keyframe, options_.max_adjusted_keyframes, session_);
  auto adjusted = AdjustKeyframes(edit, free, adjustment);
  // A solver that finds no better answer leaves the map as it was: no reason to stop mapping.
  if (!adjusted.ok() && absl::IsInternal(adjusted.status())) return absl::OkStatus();
  if (!adjusted.ok()) return adjusted.status();
  report->adjustment = *adjusted;
  return absl::OkStatus();
}

void LocalMapper::Cull(map::Edit& edit, InsertionReport* report) {
  report->culled_points = culler_.Cull(edit, inserted_, options_);
  edit.UpdateCovisibility(report->keyframe);
  report->culled_keyframes = CullKeyframes(edit, report->keyframe, options_.redundancy, [&](KeyframeId id) {
    // The newest are still gaining points.
    if (id.value() + static_cast<KeyframeId::Value>(options_.young_keyframes) >= report->keyframe.value()) return false;
    return EraseKeyframe(edit, id);
  });
}

bool LocalMapper::EraseKeyframe(map::Edit& edit, KeyframeId id) {
  const map::Keyframe culled = edit.keyframe(id);
  if (IsHeld(edit, culled, session_)) return false;
  on_cull_(edit, culled, edit.keyframe(culled.parent));
  return edit.EraseKeyframe(id);
}

int LocalMapper::CullRedundant(map::Edit& edit, std::vector<KeyframeId> keyframes) {
  return CullAmong(edit, std::move(keyframes), options_.redundancy_of_visits,
                   [&](KeyframeId id) { return EraseKeyframe(edit, id); });
}

}  // namespace cairn::mapping

// What follows the insertion of one keyframe: new points, fusion of duplicates, local bundle adjustment, culling. All
// in one Edit, so that the map goes from one good state to the next (Lee and Civera, RA-L 2019, Sec. V-D; Mur-Artal et
// al., "ORB-SLAM", T-RO 2015, Sec. VI).
#pragma once

#include <functional>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "base/status.h"
#include "map/edit.h"
#include "mapping/culling.h"
#include "mapping/feature_mapper_options.h"
#include "mapping/grid_cache.h"
#include "mapping/keypoint_depth.h"
#include "mapping/local_adjustment.h"

namespace cairn::mapping {

struct InsertionRequest {
  map::Keyframe keyframe;                 // features, times, poses; the id and links are made here
  std::span<const PointId> points;        // per feature: the point it observes, or none; may be empty
  std::span<const KeypointDepth> depths;  // per feature, from the direct module
  double map_per_direct = 1.0;
  bool points_from_depths = false;  // also make points of depths alone: at a start, or where the map is thin
  KeyframeId parent;                // in the spanning tree, should it share no points with any (may be none)
  std::vector<KeyframeId> nearby;   // keyframes around it, linked or not
};

struct InsertionReport {
  KeyframeId keyframe;
  int new_points = 0;
  int fused_points = 0;
  int culled_points = 0;
  int culled_keyframes = 0;
  LocalAdjustmentReport adjustment;
  double new_points_ms = 0.0;
  double fuse_ms = 0.0;
  double adjust_ms = 0.0;
  double cull_ms = 0.0;
};

class LocalMapper {
 public:
  // Called before a keyframe leaves the map, with its heir.
  using OnCull = std::function<void(const map::Edit& edit, const map::Keyframe& culled, const map::Keyframe& heir)>;

  // `session`: whose keyframes are inserted; what others have made of an aligned component stays (mapping/held.h).
  LocalMapper(const FeatureMapperOptions& options, SessionId session, OnCull on_cull)
      : options_(options), session_(session), on_cull_(std::move(on_cull)) {}

  // Counts for the points' found ratios; they reach the map with the next insertion.
  void CountVisible(std::span<const PointId> visible, std::span<const PointId> found);

  absl::StatusOr<InsertionReport> Insert(map::Edit& edit, InsertionRequest request);

  // At the end of a session: those of its `keyframes` that show nothing which others do not. Returns how many went.
  int CullRedundant(map::Edit& edit, std::vector<KeyframeId> keyframes);

  int keyframes_inserted() const { return inserted_; }

 private:
  void FlushVisibility(map::Edit& edit);
  void AddPoints(map::Edit& edit, const InsertionRequest& request, InsertionReport* report);
  void Fuse(map::Edit& edit, const InsertionRequest& request, InsertionReport* report);
  absl::Status Adjust(map::Edit& edit, InsertionReport* report);
  void Cull(map::Edit& edit, InsertionReport* report);
  bool EraseKeyframe(map::Edit& edit, KeyframeId id);

  const FeatureMapperOptions options_;
  const SessionId session_;
  OnCull on_cull_;
  GridCache grids_;
  PointCuller culler_;
  int inserted_ = 0;
  std::map<PointId, std::pair<int, int>> visibility_;  // expected and found since the last insertion
};

}  // namespace cairn::mapping

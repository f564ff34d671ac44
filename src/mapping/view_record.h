// What a keyframe that is not in the map saw of it, so that its pose can be refined again once the map has changed.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "geometry/pinhole.h"
#include "map/snapshot.h"

namespace cairn::mapping {

struct ViewRecord {
  struct Sight {
    PointId point;
    float x_px = 0.0f;
    float y_px = 0.0f;
    float sigma_px = 1.0f;
  };
  std::vector<Sight> sights;

  bool empty() const { return sights.empty(); }
};

// `points`: per keypoint, or none.
ViewRecord MakeViewRecord(std::span<const image::Keypoint> keypoints, std::span<const PointId> points,
                          const image::OrbParameters& orb);

// camera_from_map by motion-only bundle adjustment from `guess`; nothing if fewer than `min_inliers` of the points are
// left or agree.
std::optional<SE3> RefineView(const map::Snapshot& map, const Pinhole& pinhole, const ViewRecord& view,
                              const SE3& guess, int min_inliers);

}  // namespace cairn::mapping

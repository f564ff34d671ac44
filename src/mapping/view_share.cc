#include "mapping/view_share.h"

#include <cstdint>
#include <vector>

namespace cairn::mapping {
namespace {

constexpr double kAroundShare = 0.05;  // of the image's width: what is seen there is about the same surface
constexpr double kBehind = 1.15;       // times the depth of all that is seen around
constexpr int kMinAround = 2;

class Surroundings {
 public:
  Surroundings(const map::Snapshot& map, const map::Keyframe& viewer, const image::FeatureGrid& grid)
      : map_(map), viewer_(viewer), grid_(grid) {}

  bool Hide(const Vector3d& point_c) {
    const Pinhole& pinhole = map_.pinhole(viewer_.camera);
    const Vector2d pixel = pinhole.Project(point_c);
    grid_.Query(pixel.x(), pixel.y(), kAroundShare * pinhole.width_px, 0, map_.info().orb.num_levels - 1, &nearby_);
    int nearer = 0;
    for (const std::uint32_t feature : nearby_) {
      const map::MapPoint* own = viewer_.points[feature] ? map_.points().Find(viewer_.points[feature]) : nullptr;
      if (own == nullptr) continue;
      const double depth = (viewer_.camera_from_map * own->position).z();
      if (depth * kBehind >= point_c.z()) return false;
      ++nearer;
    }
    return nearer >= kMinAround;
  }

 private:
  const map::Snapshot& map_;
  const map::Keyframe& viewer_;
  const image::FeatureGrid& grid_;
  std::vector<std::uint32_t> nearby_;  // keeps its memory
};

}  // namespace

ViewShare ShareSeen(const map::Snapshot& map, const map::Keyframe& viewer, const Sim3& viewer_from_map,
                    std::span<const map::MapPoint* const> points, const tracking::ProjectionMatches& matches,
                    const image::FeatureGrid& grid) {
  ViewShare share;
  share.found = matches.matches.size();
  share.expected = share.found;
  Surroundings surroundings(map, viewer, grid);
  auto match = matches.matches.begin();  // ascending by point, as the visible ones are
  for (const std::uint32_t visible : matches.visible) {
    while (match != matches.matches.end() && match->point < visible) ++match;
    if (match != matches.matches.end() && match->point == visible) continue;
    share.expected += surroundings.Hide(viewer_from_map * points[visible]->position) ? 0 : 1;
  }
  return share;
}

}  // namespace cairn::mapping

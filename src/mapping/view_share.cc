#include "mapping/view_share.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace cairn::mapping {
namespace {

constexpr double kAroundShare = 0.05;  // of the image's width: what is seen there is about the same surface
constexpr double kBehind = 1.15;       // times the depth of all that is seen around
constexpr int kMinAround = 2;
constexpr int kCells = 8;          // per side of the image
constexpr int kMinExpected = 6;    // points in a cell
constexpr double kMinFound = 0.1;  // of these

// What a keyframe sees by itself.
class OwnView {
 public:
  OwnView(const map::Snapshot& map, const map::Keyframe& viewer, const image::FeatureGrid& grid)
      : map_(map), pinhole_(map.pinhole(viewer.camera)), viewer_(viewer), grid_(grid) {}

  std::size_t Cell(const Vector3d& point_c) const {
    const Vector2d pixel = pinhole_.Project(point_c);
    const auto along = [](double share) { return std::clamp(static_cast<int>(share * kCells), 0, kCells - 1); };
    return static_cast<std::size_t>(along(pixel.y() / pinhole_.height_px) * kCells +
                                    along(pixel.x() / pinhole_.width_px));
  }

  bool CouldSee(const Vector3d& point_c) {
    const Vector2d pixel = pinhole_.Project(point_c);
    grid_.Query(pixel.x(), pixel.y(), kAroundShare * pinhole_.width_px, 0, map_.info().orb.num_levels - 1, &nearby_);
    int around = 0, nearer = 0;
    for (const std::uint32_t feature : nearby_) {
      const map::MapPoint* own = viewer_.points[feature] ? map_.points().Find(viewer_.points[feature]) : nullptr;
      if (own == nullptr) continue;
      ++around;
      nearer += kBehind * (viewer_.camera_from_map * own->position).z() < point_c.z() ? 1 : 0;
    }
    return around >= kMinAround && nearer < around;
  }

 private:
  const map::Snapshot& map_;
  const Pinhole& pinhole_;
  const map::Keyframe& viewer_;
  const image::FeatureGrid& grid_;
  std::vector<std::uint32_t> nearby_;  // keeps its memory
};

}  // namespace

ViewShare ShareSeen(const map::Snapshot& map, const map::Keyframe& viewer, const Sim3& viewer_from_map,
                    std::span<const map::MapPoint* const> points, const tracking::ProjectionMatches& matches,
                    const image::FeatureGrid& grid) {
  struct Count {
    int expected = 0, found = 0;
  };
  std::array<Count, kCells * kCells> cells;
  OwnView view(map, viewer, grid);
  auto match = matches.matches.begin();  // ascending by point, as the visible ones are
  for (const std::uint32_t visible : matches.visible) {
    while (match != matches.matches.end() && match->point < visible) ++match;
    const bool found = match != matches.matches.end() && match->point == visible;
    const Vector3d point_c = viewer_from_map * points[visible]->position;
    if (!found && !view.CouldSee(point_c)) continue;
    Count& cell = cells[view.Cell(point_c)];
    ++cell.expected;
    cell.found += found ? 1 : 0;
  }
  ViewShare share;
  for (const Count& cell : cells) {
    if (cell.expected < kMinExpected) continue;
    ++share.expected;
    share.seen += cell.found >= kMinFound * cell.expected ? 1 : 0;
  }
  return share;
}

}  // namespace cairn::mapping

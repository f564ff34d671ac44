#include "mapping/view_share.h"

#include <gtest/gtest.h>

#include <functional>
#include <numeric>
#include <vector>

#include "mapping/testing_loop.h"

namespace cairn::mapping {
namespace {

// A keyframe of a corridor, and the points that it sees as another map might have them.
class AView : public ::testing::Test {
 protected:
  AView() {
    for (int i = 0; i < 8; ++i) viewer_ = ring_.AddKeyframe();
    for (const PointId id : viewer().points) {
      if (id) points_.push_back(map().point(id));
    }
  }

  const map::Snapshot& map() const { return *ring_.map(); }
  const map::Keyframe& viewer() const { return map().keyframe(viewer_); }

  // All should be seen; those are for which `found` says so by the side of the image, 0 to 1 from left to right.
  ViewShare Share(const std::function<bool(double)>& found) const {
    const Pinhole& pinhole = map().pinhole(viewer().camera);
    std::vector<const map::MapPoint*> points;
    tracking::ProjectionMatches matches;
    for (const map::MapPoint& point : points_) {
      const auto i = static_cast<std::uint32_t>(points.size());
      points.push_back(&point);
      matches.visible.push_back(i);
      const Vector2d pixel = pinhole.Project(viewer().camera_from_map * point.position);
      if (found(pixel.x() / pinhole.width_px)) matches.matches.push_back({i, i, 20});
    }
    const image::FeatureGrid grid(viewer().keypoints(), pinhole.width_px, pinhole.height_px);
    return ShareSeen(map(), viewer(), Sim3(viewer().camera_from_map), points, matches, grid);
  }

  // Moved along the rays on which the keyframe sees them.
  void MoveTo(double depths) {
    const SE3 map_from_camera = viewer().camera_from_map.Inverse();
    for (map::MapPoint& point : points_) {
      point.position = map_from_camera * (depths * (viewer().camera_from_map * point.position));
    }
  }

  testing::Ring ring_{{.points = 12000}};
  KeyframeId viewer_;
  std::vector<map::MapPoint> points_;
};

TEST_F(AView, IsSeenWholeWhereThePlaceIsTheSame) {
  const ViewShare all = Share([](double) { return true; });
  EXPECT_GE(all.expected, 12);
  EXPECT_EQ(all.seen, all.expected);
  EXPECT_EQ(Share([](double) { return false; }).seen, 0);
}

TEST_F(AView, SharesWhatIsInBoth) {
  const ViewShare left = Share([](double x) { return x < 0.5; });
  EXPECT_GT(left.value(), 0.3);
  EXPECT_LT(left.value(), 0.7);
}

// How many of a cell's points are found says more of light and distance than of the place.
TEST_F(AView, NeedsOnlySomePointsOfEachCell) {
  int count = 0;
  EXPECT_GE(Share([&](double) { return ++count % 3 == 0; }).value(), 0.9);
}

TEST_F(AView, ExpectsNothingBehindWhatItSees) {
  MoveTo(20.0);
  EXPECT_EQ(Share([](double) { return false; }).expected, 0);
  MoveTo(1.0 / 80.0);  // in front of it
  EXPECT_GE(Share([](double) { return false; }).expected, 12);
}

}  // namespace
}  // namespace cairn::mapping

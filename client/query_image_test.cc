#include "client/query_image.h"

#include <gtest/gtest.h>

#include "client/conformance/conformance_map.h"

namespace cairn::client {
namespace {

Pinhole Finer(double factor) {
  Pinhole pinhole = conformance::TheConformanceMap().pinhole;
  pinhole.fx_px *= factor;
  pinhole.fy_px *= factor;
  return pinhole;
}

TEST(QueryImage, OnlyMuchFinerPixelsAreReduced) {
  const map::Snapshot& map = *conformance::TheConformanceMap().snapshot;
  EXPECT_EQ(ScalesFor(map, Finer(0.5)), std::vector<double>{1.0});
  EXPECT_EQ(ScalesFor(map, Finer(1.4)), std::vector<double>{1.0});
  const std::vector<double> scales = ScalesFor(map, Finer(4.0));
  ASSERT_EQ(scales.size(), 2u);
  EXPECT_NEAR(scales[0], 0.25, 1e-12);
  EXPECT_EQ(scales[1], 1.0);
}

// Features of a reduced image lie on the rays that they have in the whole one.
TEST(QueryImage, ReducedFeaturesLookTheSameWay) {
  const conformance::ConformanceMap& map = conformance::TheConformanceMap();
  const Pinhole& small = map.pinhole;
  const Pinhole large{2 * small.width_px, 2 * small.height_px,     2.0 * small.fx_px,
                      2.0 * small.fy_px,  2.0 * small.cx_px + 0.5, 2.0 * small.cy_px + 0.5};
  const SE3 pose = conformance::LookInRoom({0.1, 0.0, -1.4}, 0.1);
  const auto undistorter = image::Undistorter::Create(Camera::FromPinhole(large));
  ASSERT_TRUE(undistorter.ok());
  const auto reduced = ExtractQuery(*map.snapshot, *undistorter, map.room.Render(large, pose), 0.5, 400);
  const auto usual_undistorter = image::Undistorter::Create(Camera::FromPinhole(small));
  const auto usual = ExtractQuery(*map.snapshot, *usual_undistorter, map.room.Render(small, pose), 1.0, 400);
  ASSERT_TRUE(reduced.ok() && usual.ok());
  EXPECT_EQ(reduced->pinhole.width_px, small.width_px);
  EXPECT_NEAR(reduced->pinhole.fx_px, small.fx_px, 1e-9);
  EXPECT_NEAR(reduced->pinhole.cx_px, small.cx_px, 1e-9);
  int near = 0;
  for (const image::Keypoint& a : reduced->features.keypoints) {
    for (const image::Keypoint& b : usual->features.keypoints) {
      if (a.octave == b.octave && std::hypot(a.x_px - b.x_px, a.y_px - b.y_px) < 0.5F) {
        ++near;
        break;
      }
    }
  }
  EXPECT_GT(near, 200);
}

}  // namespace
}  // namespace cairn::client

#include "geometry/triangulation.h"

#include <gtest/gtest.h>

#include <vector>

#include "base/random.h"

namespace cairn {
namespace {

TEST(Triangulation, TwoViewsMeetInAKnownPoint) {
  // b stands 1 to the right of a and looks the same way: a point at depth 4.
  const SE3 b_from_a(Quaterniond::Identity(), Vector3d(-1, 0, 0));
  const auto point = TriangulateTwoView(b_from_a, Vector3d(0.25, 0.5, 1.0), Vector3d(0.0, 1.0, 2.0));
  ASSERT_TRUE(point.has_value());
  EXPECT_LT((*point - Vector3d(1, 2, 4)).norm(), 1e-12);
}

TEST(Triangulation, ManyViewsFarFromTheOriginAndSmall) {
  Random random(3);
  const Vector3d truth(5e5, -4e5, 1e3);
  std::vector<SE3> cameras;
  std::vector<Vector3d> rays;
  for (int i = 0; i < 6; ++i) {
    const Vector3d centre = truth + Vector3d(random.Normal(), random.Normal(), random.Normal()) * 0.01;
    const SE3 world_from_camera(ExpSO3({random.Normal(), random.Normal(), random.Normal()}), centre);
    cameras.push_back(world_from_camera.Inverse());
    rays.push_back((world_from_camera.rotation().conjugate() * (truth - centre)) * random.Uniform(0.5, 3.0));
  }
  const auto point = TriangulateViews(cameras, rays);
  ASSERT_TRUE(point.has_value());
  EXPECT_LT((*point - truth).norm(), 1e-6);
}

TEST(Triangulation, NoisyRaysStayNearTheTruth) {
  Random random(4);
  const Vector3d truth(0.2, -0.1, 3.0);
  std::vector<SE3> cameras;
  std::vector<Vector3d> rays;
  for (int i = 0; i < 10; ++i) {
    cameras.push_back(SE3(Quaterniond::Identity(), Vector3d(-0.1 * i, 0.02 * i, 0)));
    const Vector3d seen = cameras.back() * truth;
    rays.push_back(seen / seen.z() + Vector3d(random.Normal(), random.Normal(), 0) * 1e-3);
  }
  const auto point = TriangulateViews(cameras, rays);
  ASSERT_TRUE(point.has_value());
  EXPECT_LT((*point - truth).norm(), 0.03);
}

TEST(Triangulation, RefusesWhatHasNoAnswer) {
  const SE3 b_from_a(Quaterniond::Identity(), Vector3d(-1, 0, 0));
  // Parallel: at infinity. Diverging: behind. On the baseline: any depth. No baseline. Bad numbers.
  EXPECT_FALSE(TriangulateTwoView(b_from_a, {0, 0, 1}, {0, 0, 1}).has_value());
  EXPECT_FALSE(TriangulateTwoView(b_from_a, {-0.1, 0, 1}, {0.1, 0, 1}).has_value());
  EXPECT_FALSE(TriangulateTwoView(b_from_a, {1, 0, 0}, {1, 0, 0}).has_value());
  EXPECT_FALSE(TriangulateTwoView(SE3(), {0, 0, 1}, {0, 0, 1}).has_value());
  EXPECT_FALSE(TriangulateTwoView(b_from_a, {0, 0, 0}, {0, 0, 1}).has_value());
  EXPECT_FALSE(TriangulateTwoView(b_from_a, {NAN, 0, 1}, {0, 0, 1}).has_value());
  EXPECT_FALSE(TriangulateViews({}, {}).has_value());
}

TEST(Triangulation, AnglesAreExactWhenSmall) {
  EXPECT_NEAR(AngleBetweenRad({1, 0, 0}, {0, 3, 0}), 1.5707963267948966, 1e-15);
  EXPECT_NEAR(AngleBetweenRad({0, 0, 1}, {1e-9, 0, 1}), 1e-9, 1e-18);
  EXPECT_NEAR(AngleBetweenRad({0, 0, 1}, {0, 0, -2}), 3.141592653589793, 1e-15);
  EXPECT_NEAR(ParallaxRad({0, 0, 1}, {-1, 0, 0}, {1, 0, 0}), 1.5707963267948966, 1e-12);
}

}  // namespace
}  // namespace cairn

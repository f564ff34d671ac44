#include "tracking/calibration_search.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/random.h"

namespace cairn::tracking {
namespace {

using optimization::PoseObservation;

const Pinhole kTrue{640, 480, 500.0, 500.0, 319.5, 239.5};

Pinhole Wrong(double factor) {
  Pinhole pinhole = kTrue;
  pinhole.fx_px *= factor;
  pinhole.fy_px *= factor;
  return pinhole;
}

struct Matches {
  SE3 camera_from_map;
  std::vector<PoseObservation> all;
};

// Of a scene between two depths, of which a share is wrong.
Matches Match(std::uint64_t seed, double nearest, double farthest, double wrong_share) {
  Random random(seed);
  Vector6d tangent;
  for (int i = 0; i < 6; ++i) tangent[i] = 0.5 * random.Normal();
  Matches matches{SE3::Exp(tangent), {}};
  for (int i = 0; i < 150; ++i) {
    const Vector2d pixel(random.Uniform(0, 639), random.Uniform(0, 479));
    PoseObservation o;
    o.sigma_px = std::pow(1.2, static_cast<double>(random.Below(6)));
    o.point = matches.camera_from_map.Inverse() * (random.Uniform(nearest, farthest) * kTrue.Unproject(pixel));
    o.pixel = pixel + 0.8 * o.sigma_px * Vector2d(random.Normal(), random.Normal());
    if (random.Uniform() < wrong_share) o.pixel = {random.Uniform(0, 639), random.Uniform(0, 479)};
    matches.all.push_back(o);
  }
  return matches;
}

TEST(SearchCalibration, FindsOneThatIsFarOff) {
  for (const double factor : {0.4, 0.5, 0.65, 0.8, 1.25, 1.5, 2.0, 2.4}) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const Matches matches = Match(seed, 1.0, 5.0, 0.3);
      const auto other = SearchCalibration(Wrong(factor), matches.all, {});
      ASSERT_TRUE(other) << factor << " " << seed;
      EXPECT_NEAR(std::log(other->pinhole.fx_px / kTrue.fx_px), 0.0, 0.05) << factor << " " << seed;
      EXPECT_GT(other->num_inliers, 80);
    }
  }
}

// From a pose that only what is in the middle of the image agrees with.
TEST(SearchCalibration, GoesOnFromAPoseThatFewAgreeWith) {
  for (const double factor : {0.5, 0.7, 1.4, 1.9}) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const Matches matches = Match(seed, 1.0, 5.0, 0.3);
      const auto pose = SolvePnpRansac(Wrong(factor), matches.all);
      ASSERT_TRUE(pose.ok());
      const auto other = SearchCalibration(Wrong(factor), pose->camera_from_map, matches.all);
      ASSERT_TRUE(other) << factor << " " << seed;
      EXPECT_TRUE(ManyMore(other->num_inliers, pose->num_inliers));
      EXPECT_NEAR(std::log(other->pinhole.fx_px / kTrue.fx_px), 0.0, 0.05) << factor << " " << seed;
    }
  }
}

TEST(SearchCalibration, FindsNoBetterOneWhereItIsRight) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const Matches matches = Match(seed, seed % 2 == 0 ? 1.0 : 3.0, 5.0, 0.4);
    const auto pose = SolvePnpRansac(kTrue, matches.all);
    ASSERT_TRUE(pose.ok());
    const auto other = SearchCalibration(kTrue, pose->camera_from_map, matches.all);
    ASSERT_TRUE(other);
    EXPECT_FALSE(ManyMore(other->num_inliers, pose->num_inliers)) << seed;
  }
}

TEST(SearchCalibration, WrongMatchesHaveNone) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const Matches matches = Match(seed, 1.0, 5.0, 1.0);
    const auto other = SearchCalibration(kTrue, matches.all, {});
    EXPECT_TRUE(!other || other->num_inliers < 15) << seed;
  }
}

}  // namespace
}  // namespace cairn::tracking

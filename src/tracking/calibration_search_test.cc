#include "tracking/calibration_search.h"

#include <gtest/gtest.h>

#include <cmath>

#include "optimization/testing_photo.h"

namespace cairn::tracking {
namespace {

const Pinhole kTrue{640, 480, 500.0, 500.0, 319.5, 239.5};

Pinhole Wrong(double factor) { return optimization::WithFocal(kTrue, factor); }

// Of a scene between two depths, of which a share is wrong.
optimization::Photo Match(std::uint64_t seed, double nearest, double farthest, double wrong_share) {
  return optimization::TakePhoto(
      kTrue, seed,
      {.wrong_share = wrong_share, .nearest = nearest, .farthest = farthest, .num_matches = 150, .pose_spread = 0.5});
}

TEST(SearchCalibration, FindsOneThatIsFarOff) {
  for (const double factor : {0.4, 0.5, 0.65, 0.8, 1.25, 1.5, 2.0, 2.4}) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const optimization::Photo matches = Match(seed, 1.0, 5.0, 0.3);
      const auto other = SearchCalibration(Wrong(factor), matches.observations, {});
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
      const optimization::Photo matches = Match(seed, 1.0, 5.0, 0.3);
      const auto pose = SolvePnpRansac(Wrong(factor), matches.observations);
      ASSERT_TRUE(pose.ok());
      const auto other = SearchCalibration(Wrong(factor), pose->camera_from_map, matches.observations);
      ASSERT_TRUE(other) << factor << " " << seed;
      EXPECT_TRUE(ManyMore(other->num_inliers, pose->num_inliers));
      EXPECT_NEAR(std::log(other->pinhole.fx_px / kTrue.fx_px), 0.0, 0.05) << factor << " " << seed;
    }
  }
}

TEST(SearchCalibration, FindsNoBetterOneWhereItIsRight) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const optimization::Photo matches = Match(seed, seed % 2 == 0 ? 1.0 : 3.0, 5.0, 0.4);
    const auto pose = SolvePnpRansac(kTrue, matches.observations);
    ASSERT_TRUE(pose.ok());
    const auto other = SearchCalibration(kTrue, pose->camera_from_map, matches.observations);
    ASSERT_TRUE(other);
    EXPECT_FALSE(ManyMore(other->num_inliers, pose->num_inliers)) << seed;
  }
}

TEST(SearchCalibration, WrongMatchesHaveNone) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const optimization::Photo matches = Match(seed, 1.0, 5.0, 1.0);
    const auto other = SearchCalibration(kTrue, matches.observations, {});
    EXPECT_TRUE(!other || other->num_inliers < 15) << seed;
  }
}

}  // namespace
}  // namespace cairn::tracking

#include "optimization/focal_refinement.h"

#include <gtest/gtest.h>

#include "base/random.h"

namespace cairn::optimization {
namespace {

const Pinhole kTrue{640, 480, 420.0, 420.0, 319.5, 239.5};

std::vector<PoseObservation> Observe(const SE3& truth, int count, double noise, double nearest, double farthest,
                                     Random& random) {
  std::vector<PoseObservation> observations;
  for (int i = 0; i < count; ++i) {
    const Vector2d pixel(random.Uniform(0, 639), random.Uniform(0, 479));
    PoseObservation o;
    o.point = truth.Inverse() * (random.Uniform(nearest, farthest) * kTrue.Unproject(pixel));
    o.pixel = pixel + noise * Vector2d(random.Normal(), random.Normal());
    observations.push_back(o);
  }
  return observations;
}

TEST(FocalRefinement, FindsAFocalLengthThatIsOff) {
  Random random(3);
  const SE3 truth = SE3::Exp((Vector6d() << 0.3, -0.2, 0.5, 0.1, 0.2, -0.1).finished());
  for (const double off : {0.8, 0.95, 1.05, 1.2}) {
    const auto observations = Observe(truth, 300, 0.5, 1.0, 5.0, random);
    Pinhole claimed = kTrue;
    claimed.fx_px *= off;
    claimed.fy_px *= off;
    const auto pose = RefinePose(claimed, truth, observations);
    ASSERT_TRUE(pose.ok());
    const auto found = RefineFocal(claimed, pose->camera_from_map, observations);
    ASSERT_TRUE(found.ok()) << found.status();
    EXPECT_NEAR(found->factor, 1.0 / off, 5.0 * found->factor_sigma);
    EXPECT_LT(found->factor_sigma, 0.005);
    EXPECT_LT(found->chi2, 0.7 * found->chi2_before);
    EXPECT_LT((found->camera_from_map.Inverse().translation() - truth.Inverse().translation()).norm(), 0.02);
  }
}

TEST(FocalRefinement, IsSureOfOneWhereNothingIsWrong) {
  Random random(4);
  const SE3 truth = SE3::Exp((Vector6d() << 0.3, -0.2, 0.5, 0.1, 0.2, -0.1).finished());
  double squared = 0.0;
  constexpr int kTrials = 200;
  for (int i = 0; i < kTrials; ++i) {
    const auto found = RefineFocal(kTrue, truth, Observe(truth, 120, 1.0, 1.0, 5.0, random));
    ASSERT_TRUE(found.ok());
    const double error = (found->factor - 1.0) / found->factor_sigma;
    squared += error * error / kTrials;
  }
  EXPECT_NEAR(squared, 1.0, 0.35);
}

// A wall seen frontally: nearer with a shorter lens looks the same.
TEST(FocalRefinement, AFrontalPlaneLeavesItOpen) {
  Random random(5);
  const auto found = RefineFocal(kTrue, SE3(), Observe(SE3(), 200, 0.5, 3.0, 3.0, random));
  EXPECT_TRUE(!found.ok() || found->factor_sigma > 0.02) << found->factor << " +- " << found->factor_sigma;
  EXPECT_FALSE(RefineFocal(kTrue, SE3(), {}).ok());
}

}  // namespace
}  // namespace cairn::optimization

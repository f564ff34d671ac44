#include "tracking/pnp_ransac.h"

#include <gtest/gtest.h>

#include "tracking/testing_world.h"

namespace cairn::tracking {
namespace {

using namespace testing_world;  // NOLINT
using optimization::PoseObservation;

std::vector<PoseObservation> Matches(const SE3& truth, int right, int wrong, Random& random) {
  std::vector<PoseObservation> matches;
  for (int i = 0; i < right + wrong; ++i) {
    const Vector2d pixel(random.Uniform(0, 639), random.Uniform(0, 479));
    PoseObservation match;
    match.point = truth.Inverse() * (random.Uniform(1, 5) * kPinhole.Unproject(pixel));
    match.pixel = i < right ? Vector2d(pixel + 0.5 * Vector2d(random.Normal(), random.Normal()))
                            : Vector2d(random.Uniform(0, 639), random.Uniform(0, 479));
    matches.push_back(match);
  }
  for (std::size_t i = matches.size(); i > 1; --i) std::swap(matches[i - 1], matches[random.Below(i)]);
  return matches;
}

TEST(PnpRansac, FindsThePoseAmongManyOutliers) {
  Random random(1);
  for (const int wrong : {0, 60, 140}) {
    const SE3 truth = Look({random.Normal(), random.Normal(), random.Normal()}, random.Uniform(-3, 3));
    const auto matches = Matches(truth, 60, wrong, random);
    const auto solution = SolvePnpRansac(kPinhole, matches);
    ASSERT_TRUE(solution.ok()) << solution.status();
    EXPECT_TRUE(solution->found);
    EXPECT_GE(solution->num_inliers, 57);
    EXPECT_LE(solution->num_inliers, 64);
    EXPECT_LT(CenterError(solution->camera_from_map, truth), 0.02);
    EXPECT_LT(RotationErrorDeg(solution->camera_from_map, truth), 0.3);
    EXPECT_EQ(solution->inlier.size(), matches.size());
  }
}

TEST(PnpRansac, GoodMatchesFirstNeedFewIterations) {
  Random random(2);
  const SE3 truth = Look({0.2, 0.1, 0.3}, 0.4);
  auto matches = Matches(truth, 40, 0, random);
  const auto wrong = Matches(truth, 0, 160, random);
  matches.insert(matches.end(), wrong.begin(), wrong.end());
  PnpOptions options;
  options.max_iterations = 30;  // 20 % inliers would need 860 drawn evenly
  const auto solution = SolvePnpRansac(kPinhole, matches, options);
  ASSERT_TRUE(solution.ok());
  EXPECT_TRUE(solution->found);
  EXPECT_LT(CenterError(solution->camera_from_map, truth), 0.02);
}

TEST(PnpRansac, SameSeedSameAnswer) {
  Random random(3);
  const auto matches = Matches(Look({0, 0, 0}, 0.3), 30, 60, random);
  const auto a = SolvePnpRansac(kPinhole, matches), b = SolvePnpRansac(kPinhole, matches);
  ASSERT_TRUE(a.ok() && b.ok());
  EXPECT_EQ(a->iterations, b->iterations);
  EXPECT_EQ(a->inlier, b->inlier);
  EXPECT_EQ(a->camera_from_map.translation(), b->camera_from_map.translation());
}

TEST(PnpRansac, FindsNothingInNothing) {
  Random random(4);
  const auto noise = SolvePnpRansac(kPinhole, Matches(SE3(), 0, 100, random));
  ASSERT_TRUE(noise.ok());
  EXPECT_FALSE(noise->found);
  EXPECT_LT(noise->num_inliers, 10);
  const auto few = SolvePnpRansac(kPinhole, Matches(SE3(), 5, 0, random));
  ASSERT_TRUE(few.ok());
  EXPECT_FALSE(few->found);
  // All at one point: no sample can be drawn.
  const std::vector<PoseObservation> same(50, Matches(SE3(), 1, 0, random)[0]);
  const auto degenerate = SolvePnpRansac(kPinhole, same);
  ASSERT_TRUE(degenerate.ok());
  EXPECT_FALSE(degenerate->found);
  PnpOptions bad;
  bad.confidence = 1.0;
  EXPECT_EQ(SolvePnpRansac(kPinhole, same, bad).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace cairn::tracking

#include "inspect/explanation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/str_join.h"
#include "tracking/testing_world.h"

namespace cairn::inspect {
namespace {

using ::testing::HasSubstr;
namespace world = tracking::testing_world;
using tracking::RelocalizationStage;

class ExplainInARoom : public ::testing::Test {
 protected:
  ExplainInARoom() {
    world::AddRoom(Vector3d::Zero(), 4000, random_, &room_);
    const auto vocabulary = world::TrainVocabulary(room_);
    view_ = *tracking::MapView::Create(
        world::BuildMap(room_, world::PathInRoom(Vector3d::Zero(), 10), *vocabulary, {}, random_), vocabulary);
  }
  Explanation ExplainView(const SE3& camera_from_world, const tracking::SearchArea& area = {}) {
    const auto seen = world::Observe(room_, camera_from_world, view_->map().info().orb, {}, random_);
    const auto explanation = Explain(*view_, world::kPinhole, seen.features, area);
    EXPECT_TRUE(explanation.ok()) << explanation.status();
    return *explanation;
  }
  static std::string Advice(const Explanation& explanation) { return absl::StrJoin(explanation.advice, "\n"); }

  Random random_{17};
  world::World room_;
  std::shared_ptr<const tracking::MapView> view_;
};

TEST_F(ExplainInARoom, OfAViewThatIsFoundEveryStageIsKnown) {
  const SE3 pose = world::Look(Vector3d(0.3, 0.0, -1.9), 0.1);
  const Explanation e = ExplainView(pose);
  ASSERT_TRUE(e.result.localized) << e.result.reason;
  EXPECT_FALSE(e.trace.candidates.empty());
  ASSERT_GE(e.best_group, 0);
  const tracking::TracedGroup& group = e.trace.groups[static_cast<std::size_t>(e.best_group)];
  EXPECT_TRUE(group.tried);
  EXPECT_EQ(group.attempt.stage, RelocalizationStage::kDone);
  EXPECT_EQ(static_cast<int>(group.matches.size()), group.attempt.counts.word_matches);
  ASSERT_FALSE(e.near.empty());
  EXPECT_LT(e.near[0].angle_deg, 30.0);
  EXPECT_LT(e.near[0].distance, 1.0);
}

// The notes change nothing.
TEST_F(ExplainInARoom, TheAnswerIsThatOfTheRelocalizer) {
  for (const double yaw : {0.0, 0.6, 1.2, 3.0}) {
    const auto seen =
        world::Observe(room_, world::Look(Vector3d(0.5, 0.2, -1.5), yaw), view_->map().info().orb, {}, random_);
    const auto explained = *Explain(*view_, world::kPinhole, seen.features);
    const auto located =
        *tracking::Relocalizer().Relocalize(view_->map(), *view_->places(), world::kPinhole, seen.features);
    EXPECT_EQ(explained.result.localized, located.localized);
    EXPECT_EQ(explained.result.stage, located.stage);
    EXPECT_EQ(explained.result.counts.inliers, located.counts.inliers);
    EXPECT_EQ(explained.result.reason, located.reason);
    EXPECT_EQ(explained.result.place.camera_from_map.translation(), located.place.camera_from_map.translation());
  }
}

TEST_F(ExplainInARoom, AViewToTheOtherSideIsMissedAndToldSo) {
  const SE3 pose = world::Look(Vector3d(0.0, 0.0, 1.5), 3.1);  // back to the wall that no keyframe sees
  const Explanation without = ExplainView(pose);
  ASSERT_FALSE(without.result.localized);
  EXPECT_FALSE(without.advice.empty());
  EXPECT_FALSE(without.has_pose && without.pose_is_given);
  tracking::SearchArea area;
  area.priors.push_back({ComponentId(1), pose.Inverse(), 3.0, 3.0});
  const Explanation with = ExplainView(pose, area);
  ASSERT_FALSE(with.result.localized);
  ASSERT_TRUE(with.pose_is_given);
  ASSERT_FALSE(with.near.empty());
  EXPECT_GT(with.near[0].angle_deg, 90.0);
  EXPECT_THAT(Advice(with), HasSubstr("degrees aside: map more there, looking in that direction"));
}

TEST_F(ExplainInARoom, AnImageOfNearlyNothingIsToldSo) {
  auto seen = world::Observe(room_, world::Look(Vector3d(0, 0, -1.9), 0.0), view_->map().info().orb, {}, random_);
  seen.features.keypoints.resize(20);
  seen.features.descriptors.resize(20);
  const auto e = *Explain(*view_, world::kPinhole, seen.features);
  EXPECT_EQ(e.result.stage, RelocalizationStage::kFeatures);
  EXPECT_EQ(e.best_group, -1);
  EXPECT_THAT(Advice(e), HasSubstr("the image has 20 features"));
}

}  // namespace
}  // namespace cairn::inspect

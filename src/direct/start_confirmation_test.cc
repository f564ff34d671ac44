// A start in doubt, with the poses that an odometry might have made of the frames after it. Whole odometries whose
// start is wrong are in odometry_confirmation_test.cc.
#include "direct/start_confirmation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "direct/testing_scene.h"

namespace cairn::direct {
namespace {

constexpr int kMostFrames = 60;

const Frame& FrameAt(int i) {
  static const std::vector<Frame> frames = [] {
    const testing::Scene scene;
    std::vector<Frame> all;
    for (int k = 0; k < kMostFrames; ++k) {
      all.push_back(scene.Render(testing::TestCamera(), testing::SwayPose(k), k));
    }
    return all;
  }();
  return frames[static_cast<std::size_t>(i)];
}

struct Judgement {
  StartVerdict verdict = StartVerdict::kOpen;
  int start_frames = 0;
  int frames = 0;  // until the verdict
  StartResult better;
};

// `pose` gives the odometry's pose of a frame, none where it is lost.
Judgement Judge(const std::function<std::optional<SE3>(int)>& pose) {
  FeatureStart corners(OdometryOptions(), testing::TestCamera());
  StartConfirmation confirmation(&corners);
  Judgement judgement;
  int i = 0;
  while (i < kMostFrames && !corners.Add(FrameAt(i)).success) ++i;
  EXPECT_LT(i, kMostFrames / 2);
  EXPECT_EQ(corners.FrameCount(), i + 1) << "the reference is the first frame";
  confirmation.Begin();
  judgement.start_frames = i + 1;
  std::vector<std::optional<SE3>> poses;
  for (int k = 0; k <= i; ++k) poses.push_back(pose(k));
  while (++i < kMostFrames && judgement.verdict == StartVerdict::kOpen) {
    poses.push_back(pose(i));
    judgement.verdict = confirmation.Judge(FrameAt(i), poses.back().has_value(), poses, &judgement.better);
    ++judgement.frames;
  }
  return judgement;
}

TEST(StartConfirmation, TheTruthIsRightOnceTheCameraHasMovedAsFarAgain) {
  const Judgement judgement = Judge([](int i) { return testing::SwayPose(i); });
  EXPECT_EQ(judgement.verdict, StartVerdict::kRight);
  EXPECT_GE(judgement.frames, 5);
  EXPECT_LE(judgement.frames, judgement.start_frames + 2);
}

// Neither its scale nor its frame makes a pose wrong.
TEST(StartConfirmation, TheFrameAndItsUnitAreFree) {
  const SE3 elsewhere(ExpSO3(Vector3d(0.3, -0.2, 0.1)), Vector3d(4, 5, 6));
  const Judgement judgement = Judge([&](int i) {
    const SE3 moved = testing::SwayPose(0).Inverse() * testing::SwayPose(i);
    return elsewhere * SE3(moved.rotation(), 0.25 * moved.translation());
  });
  EXPECT_EQ(judgement.verdict, StartVerdict::kRight);
}

// A camera that turns where the true one shifts.
TEST(StartConfirmation, PosesThatDoNotExplainTheCornersAreWrongAndABetterAnswerIsGiven) {
  const Judgement judgement = Judge([](int i) {
    const SE3 moved = testing::SwayPose(0).Inverse() * testing::SwayPose(i);
    return SE3(moved.rotation().conjugate(), -moved.translation());
  });
  EXPECT_EQ(judgement.verdict, StartVerdict::kWrong);
  ASSERT_TRUE(judgement.better.success);
  EXPECT_EQ(judgement.better.camera_from_reference.size(),
            static_cast<std::size_t>(judgement.start_frames + judgement.frames));
}

// Lost frames say nothing against a start; it is not doubted for ever.
TEST(StartConfirmation, EndsWhileTheOdometryIsLost) {
  const Judgement judgement =
      Judge([](int i) { return i < 12 ? std::optional<SE3>(testing::SwayPose(i)) : std::nullopt; });
  EXPECT_EQ(judgement.verdict, StartVerdict::kRight);
  EXPECT_EQ(judgement.frames, 30);
}

// After the start the view turns away for good, and then shifts on as before.
SE3 TurningAway(int i, int turns_from) {
  const double turned_rad = 0.1 * std::clamp(i - turns_from, 0, 12);
  return testing::SwayPose(i) * SE3(ExpSO3(Vector3d(0, -turned_rad, 0)), Vector3d::Zero());
}

struct SecondLook {
  StartVerdict first = StartVerdict::kOpen;
  StartVerdict second = StartVerdict::kOpen;
};

// `pose`: what an odometry made of the second part, given the truth.
SecondLook LookTwice(const std::function<SE3(const SE3&)>& pose) {
  const testing::Scene scene;
  FeatureStart corners(OdometryOptions(), testing::TestCamera());
  StartConfirmation confirmation(&corners);
  SecondLook look;
  std::vector<std::optional<SE3>> poses;
  int i = 0;
  for (; i < kMostFrames && !corners.Add(FrameAt(i)).success; ++i) poses.push_back(testing::SwayPose(i));
  poses.push_back(testing::SwayPose(i));
  confirmation.Begin();
  const int turns_from = i;
  while (look.first == StartVerdict::kOpen && ++i < kMostFrames) {
    poses.push_back(TurningAway(i, turns_from));
    StartResult better;
    look.first = confirmation.Judge(scene.Render(testing::TestCamera(), *poses.back(), i), true, poses, &better);
  }
  corners.Reset();
  poses.clear();
  for (; i < 2 * kMostFrames && look.second == StartVerdict::kOpen; ++i) {
    const SE3 truth = TurningAway(i, turns_from);
    const StartResult second = corners.Add(scene.Render(testing::TestCamera(), truth, i));
    if (second.new_reference) poses.clear();
    poses.push_back(pose(truth));
    if (second.success) look.second = confirmation.Compare(second, poses);
  }
  return look;
}

TEST(StartConfirmation, AViewThatTurnsAwayProvesNothingAndIsLookedAtAgain) {
  const SecondLook right = LookTwice([](const SE3& truth) { return truth; });
  EXPECT_EQ(right.first, StartVerdict::kUnproven);
  EXPECT_EQ(right.second, StartVerdict::kRight);
  // An odometry that takes the shift for a turn.
  const SecondLook wrong = LookTwice([](const SE3& truth) {
    return SE3(ExpSO3(Vector3d(0, -0.3 * truth.translation().x(), 0)) * truth.rotation(), -truth.translation());
  });
  EXPECT_EQ(wrong.second, StartVerdict::kWrong);
}

}  // namespace
}  // namespace cairn::direct

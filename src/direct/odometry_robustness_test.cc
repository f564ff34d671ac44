// What happens to the odometry when the camera, the scene or the images misbehave. Scenes are rendered without noise;
// what is done to the images is seeded.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "base/random.h"
#include "direct/odometry.h"
#include "direct/testing_scene.h"
#include "direct/view_search.h"

namespace cairn::direct {
namespace {

using ::testing::HasSubstr;

std::unique_ptr<Odometry> MakeOdometry(const OdometryOptions& options = {}) {
  auto odometry = Odometry::Create(options, testing::TestCamera());
  EXPECT_TRUE(odometry.ok()) << odometry.status();
  return std::move(odometry).value();
}

constexpr int kFrames = 56;
constexpr int kSpoiltFrom = 30;  // all sequences have started by then

const std::vector<Frame>& Sway() {
  static const std::vector<Frame> frames = [] {
    std::vector<Frame> all;
    const testing::Scene scene;
    for (int i = 0; i < kFrames; ++i) all.push_back(scene.Render(testing::TestCamera(), testing::SwayPose(i), i));
    return all;
  }();
  return frames;
}

struct Outcome {
  std::vector<FrameResult> live;
  std::vector<FrameResult> final;
  OdometryStatistics statistics;
};

// Every frame passes through `spoil`, which returns false for a frame that never arrives.
Outcome Play(const std::function<bool(Frame*)>& spoil) {
  const auto odometry = MakeOdometry();
  Outcome outcome;
  for (const Frame& clean : Sway()) {
    Frame frame = clean;
    frame.image = clean.image.clone();
    if (!spoil(&frame)) continue;
    const auto result = odometry->Process(frame);
    EXPECT_TRUE(result.ok()) << result.status();
    outcome.live.push_back(*result);
  }
  odometry->Finish();
  outcome.final = odometry->FrameResults();
  outcome.statistics = odometry->Statistics();
  return outcome;
}

// Root mean square position error over the frames with a pose, scale fitted, as a share of the largest distance from
// the first of them.
double RelativeError(const std::vector<FrameResult>& results,
                     const std::function<SE3(double)>& pose_at = testing::SwayPose) {
  std::vector<Vector3d> truth, estimate;
  const FrameResult* first = nullptr;
  for (const FrameResult& r : results) {
    if (r.keyframe < 0) continue;
    if (first == nullptr) first = &r;
    const auto pose = [&](const FrameResult& of) { return pose_at(static_cast<double>(of.index)); };
    truth.push_back(pose(*first).Inverse() * pose(r).translation());
    estimate.push_back(first->direct_from_camera.Inverse() * r.direct_from_camera.translation());
  }
  double along = 0.0, squared = 0.0, length = 0.0, sum = 0.0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    along += truth[i].dot(estimate[i]), squared += estimate[i].squaredNorm();
    length = std::max(length, truth[i].norm());
  }
  for (std::size_t i = 0; i < truth.size(); ++i) sum += (truth[i] - along / squared * estimate[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(truth.size())) / length;
}

int Untracked(const std::vector<FrameResult>& results) {
  return static_cast<int>(
      std::count_if(results.begin(), results.end(), [](const FrameResult& r) { return r.keyframe < 0; }));
}

TEST(OdometryRobustness, FramesThatAreMissingForHalfASecondCostNothingElse) {
  const Outcome outcome =
      Play([](const Frame* frame) { return frame->index < kSpoiltFrom || frame->index >= kSpoiltFrom + 15; });
  EXPECT_EQ(Untracked(outcome.final), 0);
  EXPECT_EQ(outcome.statistics.segments, 1);
  EXPECT_LT(RelativeError(outcome.final), 0.015);
}

TEST(OdometryRobustness, AGapIsLongBeyondHalfASecondAndFourMissingImages) {
  EXPECT_FALSE(IsLongGap(16 / 30.0, 1 / 30.0)) << "half a second is missing";
  EXPECT_TRUE(IsLongGap(18 / 30.0, 1 / 30.0));
  EXPECT_FALSE(IsLongGap(5 / 4.0, 1 / 4.0)) << "four images are missing";
  EXPECT_TRUE(IsLongGap(6 / 4.0, 1 / 4.0));
}

// Turning along a wall without texture, seen between two that have some: new points are taken while old ones are in
// view.
TEST(OdometryRobustness, ABlankWallIsPassed) {
  const testing::Scene scene(2.2);
  const auto pose = [](double t) {
    return SE3(ExpSO3(Vector3d(0.0, -0.5 + 0.022 * t, 0.0)), Vector3d(0.02 * t - 0.4, 0.03 * std::sin(0.1 * t), 0.0));
  };
  const auto odometry = MakeOdometry();
  for (int i = 0; i < 48; ++i) ASSERT_TRUE(odometry->Process(scene.Render(testing::TestCamera(), pose(i), i)).ok());
  odometry->Finish();
  const std::vector<FrameResult> results = odometry->FrameResults();
  EXPECT_EQ(Untracked(results), 0);
  EXPECT_EQ(odometry->Statistics().segments, 1);
  EXPECT_LT(RelativeError(results, pose), 0.03);
}

// The camera turns to a wall without texture faster than new points can be had: what it goes by then is its own
// prediction, and the quality has to say so.
TEST(OdometryRobustness, ABlankWallThatFillsTheViewIsNoticedWithinThreeFrames) {
  constexpr int kTurnFrom = 30, kTurned = 36;
  const testing::Scene scene(2.15);
  const auto pose = [](double t) {
    const double yaw = -0.75 + 0.01 * std::min(t, 1.0 * kTurnFrom) + 0.09 * std::clamp(t - kTurnFrom, 0.0, 6.0);
    return SE3(ExpSO3(Vector3d(0.0, yaw, 0.0)), Vector3d(0.012 * t - 0.4, 0.03 * std::sin(0.1 * t), 0.0));
  };
  const auto odometry = MakeOdometry();
  std::vector<FrameResult> live;
  for (int i = 0; i < kTurned + 8; ++i) {
    Frame frame = scene.Render(testing::TestCamera(), pose(i), i);
    if (i >= kTurned) frame.image.setTo(150);
    const auto result = odometry->Process(frame);
    ASSERT_TRUE(result.ok());
    live.push_back(*result);
  }
  for (const FrameResult& result : live) {
    const bool turned = result.index >= kTurned, before = result.index >= 25 && result.index < kTurnFrom;
    EXPECT_LT(result.quality, turned ? 0.3 : 1.01) << result.index;
    EXPECT_GT(result.quality, before ? 0.6 : -0.01) << result.index;
    EXPECT_TRUE(result.index < kTurned + 2 || result.state == TrackingState::kLost) << result.index;
  }
}

TEST(OdometryRobustness, ASuddenChangeOfExposureIsFollowed) {
  for (double gain : {0.55, 1.5}) {
    const Outcome outcome = Play([gain](Frame* frame) {
      if (frame->index >= kSpoiltFrom) frame->image.convertTo(frame->image, -1, gain, 4.0);
      return true;
    });
    EXPECT_EQ(Untracked(outcome.final), 0) << gain;
    EXPECT_LT(RelativeError(outcome.final), 0.02) << gain;
  }
}

TEST(OdometryRobustness, MotionBlurIsFollowed) {
  const Outcome outcome = Play([](Frame* frame) {
    if (frame->index >= kSpoiltFrom && frame->index < kSpoiltFrom + 6) {
      cv::blur(frame->image, frame->image, cv::Size(13, 1));
    }
    return true;
  });
  EXPECT_EQ(Untracked(outcome.final), 0);
  EXPECT_LT(RelativeError(outcome.final), 0.015);
}

// Something before the columns [begin, end) of the image, with a pattern that begins `shift_px` further to the right.
void Cover(int begin, int end, double shift_px, std::uint32_t seed, Frame* frame) {
  for (int y = 0; y < frame->image.rows; ++y) {
    for (int x = std::max(0, begin); x < std::min(end, frame->image.cols); ++x) {
      frame->image.at<unsigned char>(y, x) =
          static_cast<unsigned char>(30.0 + 150.0 * testing::ValueNoise(0.08 * (x - shift_px), 0.08 * y, seed));
    }
  }
}

// A patterned board that moves with the camera, as a hand before the lens.
TEST(OdometryRobustness, AnObstacleBeforeHalfOfTheImageHoldsNothingBack) {
  for (const bool left : {true, false}) {
    for (const std::uint32_t seed : {99u, 5u}) {
      const Outcome outcome = Play([&](Frame* frame) {
        const int width = frame->image.cols, half = width / 2;
        if (frame->index >= 22 && frame->index < 52) Cover(left ? 0 : half, left ? half : width, 0.0, seed, frame);
        return true;
      });
      EXPECT_EQ(Untracked(outcome.final), 0);
      EXPECT_EQ(outcome.statistics.segments, 1);
      EXPECT_LT(RelativeError(outcome.final), 0.035) << left << " " << seed;
      for (const FrameResult& result : outcome.live) {
        if (result.index == 22) {
          EXPECT_LT(result.quality, 0.75);  // the number tells
        }
      }
    }
  }
}

// Nothing explains the whole image any more, but a strip of it is seen as before.
TEST(OdometryRobustness, AStripOfAHiddenViewIsEnough) {
  for (const std::uint32_t seed : {99u, 5u}) {
    const Outcome outcome = Play([&](Frame* frame) {
      if (frame->index >= 24 && frame->index < 36) Cover(0, 270, 6.0 * static_cast<double>(frame->index), seed, frame);
      return true;
    });
    EXPECT_EQ(Untracked(outcome.final), 0);
    EXPECT_EQ(outcome.statistics.segments, 1);
    EXPECT_LT(RelativeError(outcome.final), 0.12) << seed;
  }
}

// Someone walks through the view: what moves by itself is no part of the world.
TEST(OdometryRobustness, WhatPassesThroughTheViewPullsNothingAlong) {
  for (const bool to_the_right : {true, false}) {
    const Outcome outcome = Play([&](Frame* frame) {
      const int width = frame->image.cols, wide = 2 * width / 5;
      const int way = static_cast<int>((frame->index - 24) * (width + wide) / 26.0);
      if (frame->index < 24 || frame->index >= 50) return true;
      const int begin = to_the_right ? way - wide : width - way;
      Cover(begin, begin + wide, begin, 17, frame);
      return true;
    });
    EXPECT_EQ(Untracked(outcome.final), 0);
    EXPECT_EQ(outcome.statistics.segments, 1);
    EXPECT_LT(RelativeError(outcome.final), 0.02) << to_the_right;
  }
}

TEST(OdometryRobustness, CorruptFramesAreLostAtOnceAndTheNextGoodOneIsFound) {
  Random random(5);
  const Outcome outcome = Play([&random](Frame* frame) {
    if (frame->index == 30 || frame->index == 31) {
      for (int y = 0; y < frame->image.rows; ++y) {
        for (int x = 0; x < frame->image.cols; ++x) {
          frame->image.at<unsigned char>(y, x) = static_cast<unsigned char>(random.Uniform(0.0, 256.0));
        }
      }
    }
    if (frame->index == 40) frame->image.setTo(255);
    return true;
  });
  for (const FrameResult& result : outcome.final) {
    const bool corrupt = result.index == 30 || result.index == 31 || result.index == 40;
    EXPECT_EQ(result.keyframe < 0, corrupt) << result.index;
    if (corrupt) {
      EXPECT_EQ(result.state, TrackingState::kLost);
      EXPECT_EQ(result.quality, 0.0);
    }
  }
  EXPECT_EQ(outcome.statistics.segments, 1);
  EXPECT_LT(RelativeError(outcome.final), 0.015);
}

// The camera is carried off in a bag and goes on elsewhere: nothing that the odometry knows is in sight.
TEST(OdometryRobustness, AnotherPlaceIsRecognizedAsLostWithinThreeFramesAndGetsASegmentOfItsOwn) {
  OdometryOptions options;
  options.max_lost_frames = 5;
  const auto odometry = MakeOdometry(options);
  const testing::Scene scene;
  for (int i = 0; i < 26; ++i) ASSERT_TRUE(odometry->Process(Sway()[i]).ok());
  ASSERT_EQ(odometry->Statistics().segments, 1);
  int first_lost = -1;
  for (int i = 26; i < 56; ++i) {
    const SE3 elsewhere(Quaterniond::Identity(), Vector3d(9.0, -0.2, 0.5));
    const auto result = odometry->Process(scene.Render(testing::TestCamera(), elsewhere * testing::SwayPose(i), i));
    ASSERT_TRUE(result.ok());
    if (first_lost < 0 && result->state == TrackingState::kLost) first_lost = i;
  }
  ASSERT_GE(first_lost, 26);
  EXPECT_LE(first_lost, 28);
  odometry->Finish();
  EXPECT_EQ(odometry->Statistics().segments, 2);
  for (const FrameResult& result : odometry->FrameResults()) {
    if (result.index < 26 || result.keyframe < 0) continue;
    EXPECT_EQ(odometry->KeyframeTrajectory()[static_cast<std::size_t>(result.keyframe)].segment, 1) << result.index;
  }
  EXPECT_EQ(Untracked(odometry->FrameResults()), 0);  // the new segment begins with the first lost frame
}

// The camera turns away by more than the basin of tracking while it sees nothing, and is found again.
TEST(OdometryRobustness, AViewThatTurnedAwayIsFoundAmongTheLastKeyframes) {
  const auto odometry = MakeOdometry();
  const testing::Scene scene;
  for (int i = 0; i < 30; ++i) ASSERT_TRUE(odometry->Process(Sway()[i]).ok());
  Frame black = Sway()[0];
  black.image = cv::Mat(black.image.size(), CV_8UC1, cv::Scalar(0));
  for (int i = 30; i < 34; ++i) {
    black.index = i;
    black.time_ns = i * 33'333'333;
    const auto result = odometry->Process(black);
    ASSERT_TRUE(result.ok());
    EXPECT_EQ(result->state, TrackingState::kLost);
  }
  const SE3 turn(ExpSO3(Vector3d(0.03, -0.2, 0.0)), Vector3d::Zero());
  const SE3 pose = testing::SwayPose(30) * turn;
  const auto result = odometry->Process(scene.Render(testing::TestCamera(), pose, 34));
  ASSERT_TRUE(result.ok());
  ASSERT_GE(result->keyframe, 0);
  const SE3 moved = odometry->FrameResults()[29].direct_from_camera.Inverse() * result->direct_from_camera;
  const SE3 truth = testing::SwayPose(29).Inverse() * pose;
  EXPECT_LT(AngleRad(moved.rotation().conjugate() * truth.rotation()), 0.005);
}

TEST(ViewSearch, FindsHowFarTheCameraTurned) {
  const Pinhole camera = testing::TestCamera();
  const PyramidGeometry geometry = PyramidGeometry::Make(camera, false, 6, 400);
  const testing::Scene scene;
  ImagePyramid pyramid;
  pyramid.Build(Sway()[0], geometry);
  const Thumbnail reference = MakeThumbnail(pyramid, geometry);
  EXPECT_LE(reference.width, 40);
  const SE3 turned = testing::SwayPose(0) * SE3(ExpSO3(Vector3d(0.08, -0.25, 0.0)), Vector3d::Zero());
  pyramid.Build(scene.Render(camera, turned, 1), geometry);
  const ViewShift shift = FindShift(reference, MakeThumbnail(pyramid, geometry), geometry);
  EXPECT_GT(shift.correlation, 0.7);
  const Quaterniond truth = turned.rotation().conjugate() * testing::SwayPose(0).rotation();
  EXPECT_LT(AngleRad(shift.new_from_reference.conjugate() * truth), 0.05);
  Frame blank = Sway()[0];
  blank.image = cv::Mat(blank.image.size(), CV_8UC1, cv::Scalar(90));
  pyramid.Build(blank, geometry);
  EXPECT_EQ(FindShift(reference, MakeThumbnail(pyramid, geometry), geometry).correlation, -1.0);
  EXPECT_EQ(FindShift(Thumbnail(), reference, geometry).correlation, -1.0);
}

// --- starts ------------------------------------------------------------------------------------------------------

// Feeds `pose(i)` until the odometry has a pose or the frames end; the first frame with a pose, -1 if none, and the
// last message while waiting.
int FirstTracked(int frames, const std::function<Frame(int)>& render, std::string* message) {
  const auto odometry = MakeOdometry();
  for (int i = 0; i < frames; ++i) {
    const auto result = odometry->Process(render(i));
    EXPECT_TRUE(result.ok());
    if (result->keyframe >= 0) return i;
    if (i > 0) *message = result->message;
  }
  return -1;
}

TEST(OdometryStart, WaitsWhileTheCameraOnlyTurnsAndStartsOnceItMoves) {
  const testing::Scene scene;
  const auto turned = [](int i) { return SE3(ExpSO3(Vector3d(0.004 * i, -0.008 * i, 0.005 * i)), Vector3d::Zero()); };
  std::string message;
  const auto render = [&](int i) {
    const SE3 pose = i < 15 ? turned(i) : SE3(turned(15).rotation(), Vector3d(0.02 * (i - 14), 0.005 * (i - 14), 0));
    return scene.Render(testing::TestCamera(), pose, i);
  };
  const int first = FirstTracked(40, render, &message);
  EXPECT_GE(first, 15);
  EXPECT_LT(first, 40);
  EXPECT_THAT(message, HasSubstr("parallax"));
}

TEST(OdometryStart, WaitsWhileTheCameraIsStillAndStartsOnceItMoves) {
  std::string message;
  const auto render = [&](int i) {
    Frame frame = Sway()[static_cast<std::size_t>(std::max(0, i - 12))];
    frame.index = i;
    frame.time_ns = i * 33'333'333;
    return frame;
  };
  const int first = FirstTracked(50, render, &message);
  EXPECT_GE(first, 13);
  EXPECT_LT(first, 50);
  EXPECT_THAT(message, HasSubstr("not moved enough"));
}

// Held a forearm before the body, which turns away and back, fast and blurred, before the camera moves: through the
// blur the image tells nothing to a pixel, and poses tracked back through it are worth nothing.
TEST(OdometryStart, FramesBeforeItThatAreTooBlurredToTellHaveNoPose) {
  constexpr int kTurns = 12, kExposures = 5;
  const auto pose_at = [](double t) {
    if (t > kTurns) return testing::SwayPose(t - kTurns);
    const double still = std::sin(std::numbers::pi * t / kTurns), turn_rad = 0.7 * still * still;
    const Quaterniond turned = ExpSO3(Vector3d(0, turn_rad, 0));
    return SE3(turned, 0.12 * (turned * Vector3d::UnitZ() - Vector3d::UnitZ()));
  };
  const testing::Scene scene;
  const auto odometry = MakeOdometry();
  for (int i = 0; i < kTurns + 26; ++i) {
    Frame frame;
    cv::Mat sum;
    const int exposures = i < kTurns ? kExposures : 1;
    for (int k = 0; k < exposures; ++k) {  // open all the time
      frame = scene.Render(testing::TestCamera(), pose_at(i + (k + 0.5) / exposures - 0.5), i);
      if (k == 0) sum = cv::Mat::zeros(frame.image.size(), CV_32F);
      cv::accumulate(frame.image, sum);
    }
    sum.convertTo(frame.image, CV_8U, 1.0 / exposures);
    ASSERT_TRUE(odometry->Process(frame).ok());
  }
  odometry->Finish();
  const std::vector<FrameResult> results = odometry->FrameResults();
  const FrameResult &first = results[kTurns + 1], &last = results.back();
  ASSERT_GE(first.keyframe, 0);
  const auto estimate = [&](const FrameResult& a, const FrameResult& b) {
    return (a.direct_from_camera.Inverse() * b.direct_from_camera).translation();
  };
  const auto truth = [&](int a, int b) { return (pose_at(a).Inverse() * pose_at(b)).translation(); };
  const int end = static_cast<int>(results.size()) - 1;
  const double scale = truth(kTurns + 1, end).norm() / estimate(first, last).norm();
  for (int i = 0; i < kTurns; ++i) {
    const FrameResult& frame = results[static_cast<std::size_t>(i)];
    if (frame.keyframe < 0) continue;
    EXPECT_LT((scale * estimate(first, frame) - truth(kTurns + 1, i)).norm(), 0.03) << "frame " << i;
  }
}

TEST(OdometryStart, ALongWaitLosesNoPose) {
  OdometryOptions options;
  options.max_retained_frames = 12;
  options.start_features = 300;
  const auto odometry = MakeOdometry(options);
  constexpr int kWait = 140;
  const auto source = [](int i) { return i < kWait ? (i / 3) % 3 : i - kWait; };  // to and fro, less than a start needs
  std::vector<Frame> frames;
  for (int i = 0; i < kWait + 50; ++i) {
    Frame frame = Sway()[static_cast<std::size_t>(source(i))];
    frame.index = i;
    frame.time_ns = i * 33'333'333LL;
    const auto result = odometry->Process(frame);
    ASSERT_TRUE(result.ok());
    if (i < kWait) {
      ASSERT_EQ(result->keyframe, -1) << i;
    }
  }
  odometry->Finish();
  const std::vector<FrameResult> results = odometry->FrameResults();
  EXPECT_EQ(Untracked(results), 0);
  EXPECT_EQ(odometry->Statistics().segments, 1);
  int between = 0;
  // Scale from the path after the wait; the frames of the wait stay near its beginning.
  const auto estimate = [&](int i) {
    return Vector3d(results[kWait].direct_from_camera.Inverse() * results[i].direct_from_camera.translation());
  };
  const auto truth = [&](int i) {
    return Vector3d(testing::SwayPose(0).Inverse() * testing::SwayPose(source(i)).translation());
  };
  const double scale = truth(kWait + 29).norm() / estimate(kWait + 29).norm();
  for (int i = 0; i < kWait; ++i) {
    const bool interpolated = results[i].message.find("between its neighbours") != std::string::npos;
    between += interpolated;
    EXPECT_LT((scale * estimate(i) - truth(i)).norm(), 0.12 * truth(kWait + 29).norm()) << i;
  }
  EXPECT_GT(between, 60);
}

}  // namespace
}  // namespace cairn::direct

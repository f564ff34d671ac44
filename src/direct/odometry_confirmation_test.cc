// Starts that are made wrong on purpose must be found out, undone and redone, and every frame must end with a pose.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>

#include "direct/odometry_impl.h"
#include "direct/structure_adjustment.h"
#include "direct/testing_scene.h"

namespace cairn::direct {

class OdometryPeer {
 public:
  static void AlterStarts(Odometry* odometry, std::function<void(StartResult*)> alter) {
    odometry->impl_->AlterStarts(std::move(alter));
  }
};

namespace {

// A relief `factor` times as deep, seen by a camera that moves less and turns more: nearly the same images (the
// bas-relief ambiguity), and wrong depths.
void Exaggerate(double factor, StartResult* start) {
  for (SE3& pose : start->camera_from_reference) {
    const Vector3d shift = pose.translation();
    const double kept = 1.0 / factor;
    const Vector3d turn((1.0 - kept) * -shift.y(), (1.0 - kept) * shift.x(), 0.0);
    pose = SE3(ExpSO3(turn), Vector3d::Zero()) * SE3(pose.rotation(), kept * shift);
  }
  for (double& d : start->inverse_depth) d = std::max(0.02, 1.0 + factor * (d - 1.0));
}

struct Outcome {
  std::vector<FrameResult> results;
  OdometryStatistics statistics;
  std::size_t packets = 0, keyframes = 0;
};

SE3 SwayAt(int i) { return testing::SwayPose(i); }

std::vector<Frame> Rendered(int count, const std::function<SE3(int)>& pose) {
  std::vector<Frame> frames;
  const testing::Scene scene;
  for (int i = 0; i < count; ++i) frames.push_back(scene.Render(testing::TestCamera(), pose(i), i));
  return frames;
}

// `lag`: frames tracked and not optimized with yet, as with two threads.
Outcome PlayFrames(const std::vector<Frame>& frames, const std::function<void(StartResult*)>& alter, int lag) {
  auto odometry = Odometry::Create(OdometryOptions(), testing::TestCamera());
  EXPECT_TRUE(odometry.ok()) << odometry.status();
  if (alter) OdometryPeer::AlterStarts(odometry->get(), alter);
  Outcome outcome;
  for (const Frame& frame : frames) {
    EXPECT_TRUE((*odometry)->Track(frame).ok());
    while ((*odometry)->PendingFrames() > lag) (*odometry)->OptimizeNext();
    outcome.packets += (*odometry)->TakePackets().size();
  }
  (*odometry)->Finish();
  outcome.packets += (*odometry)->TakePackets().size();
  outcome.keyframes = (*odometry)->KeyframeTrajectory().size();
  outcome.results = (*odometry)->FrameResults();
  outcome.statistics = (*odometry)->Statistics();
  return outcome;
}

Outcome Play(const std::function<void(StartResult*)>& alter, int lag) {
  static const std::vector<Frame> frames = Rendered(56, SwayAt);
  return PlayFrames(frames, alter, lag);
}

// Root mean square position error with the scale fitted, as a share of the largest distance from the first frame.
double RelativeError(const std::vector<FrameResult>& results,
                     const std::function<SE3(int)>& world_from_camera = SwayAt) {
  double along = 0.0, squared = 0.0, length = 0.0, sum = 0.0;
  const auto truth = [&](const FrameResult& r) {
    return Vector3d(world_from_camera(static_cast<int>(results.front().index)).Inverse() *
                    world_from_camera(static_cast<int>(r.index)).translation());
  };
  const auto estimate = [&](const FrameResult& r) {
    return Vector3d(results.front().direct_from_camera.Inverse() * r.direct_from_camera.translation());
  };
  for (const FrameResult& r : results) {
    along += truth(r).dot(estimate(r)), squared += estimate(r).squaredNorm();
    length = std::max(length, truth(r).norm());
  }
  for (const FrameResult& r : results) sum += (truth(r) - along / squared * estimate(r)).squaredNorm();
  return std::sqrt(sum / static_cast<double>(results.size())) / length;
}

TEST(OdometryConfirmation, AGoodStartStands) {
  const Outcome outcome = Play(nullptr, 0);
  EXPECT_EQ(outcome.statistics.starts_undone, 0);
  EXPECT_EQ(outcome.packets, outcome.keyframes);
}

// Depths turned inside out, and the motion with them: a minimum of its own, which the window does not leave.
TEST(OdometryConfirmation, AWrongStartIsUndoneAndNoFrameIsLost) {
  for (int lag : {0, 3}) {
    const Outcome outcome = Play([](StartResult* start) { Exaggerate(-1.0, start); }, lag);
    EXPECT_EQ(outcome.statistics.starts_undone, 1) << lag;
    EXPECT_EQ(outcome.statistics.segments, 1);
    ASSERT_EQ(outcome.results.size(), 56u);
    for (const FrameResult& r : outcome.results) {
      ASSERT_GE(r.keyframe, 0) << "frame " << r.index;
      EXPECT_LT(r.keyframe, static_cast<std::int64_t>(outcome.keyframes));
    }
    EXPECT_EQ(outcome.packets, outcome.keyframes);  // none of the undone start
    EXPECT_LT(RelativeError(outcome.results), 0.01) << lag;
  }
}

// A relief five times too deep is what the window itself sets right.
TEST(OdometryConfirmation, AStartThatHealsStands) {
  const Outcome outcome = Play([](StartResult* start) { Exaggerate(5.0, start); }, 0);
  EXPECT_EQ(outcome.statistics.starts_undone, 0);
  EXPECT_LT(RelativeError(outcome.results), 0.01);
}

// The frame in which the corners of a sway tell its motion.
int StartOfSway() {
  static const int start = [] {
    FeatureStart corners(OdometryOptions(), testing::TestCamera());
    const testing::Scene scene;
    int i = 0;
    while (i < 40 && !corners.Add(scene.Render(testing::TestCamera(), SwayAt(i), i)).success) ++i;
    return i;
  }();
  return start;
}

// The camera sways on, but its view turns to the left before the start is proven.
SE3 TurningAway(int i) {
  const double turned_rad = 0.1 * std::clamp(i - StartOfSway() - 1, 0, 12);
  return SwayAt(i) * SE3(ExpSO3(Vector3d(0, -turned_rad, 0)), Vector3d::Zero());
}

// A good one stands. A wrong one is undone once other corners contradict it, and those begin another.
TEST(OdometryConfirmation, AStartThatNothingProvedIsLookedAtAgain) {
  const std::vector<Frame> frames = Rendered(StartOfSway() + 60, TurningAway);
  const Outcome good = PlayFrames(frames, nullptr, 0);
  EXPECT_EQ(good.statistics.starts_undone, 0);
  EXPECT_EQ(good.statistics.segments, 1);
  EXPECT_EQ(good.packets, good.keyframes);
  for (int lag : {0, 3}) {
    int starts = 0;
    const Outcome wrong = PlayFrames(
        frames,
        [&](StartResult* start) {
          if (starts++ == 0) Exaggerate(-1.0, start);
        },
        lag);
    EXPECT_EQ(wrong.statistics.starts_undone, 1) << lag;
    EXPECT_EQ(wrong.statistics.segments, 1) << lag;
    EXPECT_EQ(wrong.packets, wrong.keyframes) << lag;
    std::vector<FrameResult> turned;
    for (const FrameResult& result : wrong.results) {
      if (result.index < StartOfSway() + 14) continue;
      ASSERT_GE(result.keyframe, 0) << "frame " << result.index;
      turned.push_back(result);
    }
    EXPECT_LT(RelativeError(turned, TurningAway), 0.02) << lag;
  }
}

TEST(StructureAdjustment, FindsDepthsWithThePosesGiven) {
  StructureProblem problem;
  problem.camera = testing::TestCamera();
  problem.camera_from_reference = {SE3(ExpSO3(Vector3d(0.01, -0.02, 0.01)), Vector3d(0.1, 0.02, 0)),
                                   SE3(ExpSO3(Vector3d(0.02, -0.04, 0.0)), Vector3d(0.22, 0.01, 0.03))};
  problem.observed_px.resize(2);
  std::vector<double> truth;
  for (int i = 0; i < 20; ++i) {
    truth.push_back(0.3 + 0.06 * i);
    problem.reference_px.emplace_back(40.0 + 15.0 * i, 60.0 + 8.0 * i);
    problem.inverse_depth.push_back(0.8);
    for (int v = 0; v < 2; ++v) {
      const SE3& pose = problem.camera_from_reference[v];
      problem.observed_px[v].push_back(problem.camera.Project(
          pose.rotation() * problem.camera.Unproject(problem.reference_px[i]) + truth[i] * pose.translation()));
    }
  }
  const StructureReport report = AdjustDepths(20, &problem);
  EXPECT_LT(report.rms_px, 1e-3);
  EXPECT_EQ(report.inlier_share, 1.0);
  for (int i = 0; i < 20; ++i) EXPECT_NEAR(problem.inverse_depth[i], truth[i], 1e-4);
}

}  // namespace
}  // namespace cairn::direct

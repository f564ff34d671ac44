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

// `lag`: frames tracked and not optimized with yet, as with two threads.
Outcome Play(const std::function<void(StartResult*)>& alter, int lag) {
  auto odometry = Odometry::Create(OdometryOptions(), testing::TestCamera());
  EXPECT_TRUE(odometry.ok()) << odometry.status();
  if (alter) OdometryPeer::AlterStarts(odometry->get(), alter);
  static const std::vector<Frame> frames = [] {
    std::vector<Frame> all;
    const testing::Scene scene;
    for (int i = 0; i < 56; ++i) all.push_back(scene.Render(testing::TestCamera(), testing::SwayPose(i), i));
    return all;
  }();
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

// Root mean square position error with the scale fitted, as a share of the largest distance from the first frame.
double RelativeError(const std::vector<FrameResult>& results) {
  double along = 0.0, squared = 0.0, length = 0.0, sum = 0.0;
  const auto truth = [&](const FrameResult& r) {
    return Vector3d(testing::SwayPose(0).Inverse() * testing::SwayPose(static_cast<double>(r.index)).translation());
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

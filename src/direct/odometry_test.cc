#include "direct/odometry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "base/random.h"
#include "direct/feature_start.h"
#include "direct/pixel_selector.h"
#include "direct/structure_adjustment.h"
#include "direct/testing_scene.h"

namespace cairn::direct {
namespace {

using ::testing::AnyOf;
using ::testing::HasSubstr;

std::unique_ptr<Odometry> MakeOdometry() {
  auto odometry = Odometry::Create(OdometryOptions(), testing::TestCamera());
  EXPECT_TRUE(odometry.ok()) << odometry.status();
  return std::move(odometry).value();
}

// Sequences are rendered once for all tests.
const std::vector<Frame>& Sway() {
  static const std::vector<Frame> frames = [] {
    std::vector<Frame> all;
    const testing::Scene scene;
    for (int i = 0; i < 60; ++i) {
      all.push_back(scene.Render(testing::TestCamera(), testing::SwayPose(i), i, 1.0 + 0.1 * std::sin(0.1 * i)));
    }
    return all;
  }();
  return frames;
}

// Root mean square position error after the similarity from the first two moments of the path (rotation is given by the
// first pose, scale by the length of the path).
double RelativeError(const std::vector<FrameResult>& results) {
  double along = 0.0, squared = 0.0;
  const auto position = [&](const FrameResult& r) {
    return Vector3d(results.front().direct_from_camera.Inverse() * r.direct_from_camera.translation());
  };
  const SE3 origin = testing::SwayPose(static_cast<double>(results.front().index)).Inverse();
  double length = 0.0;
  for (const FrameResult& r : results) {
    const Vector3d truth = origin * testing::SwayPose(static_cast<double>(r.index)).translation();
    along += truth.dot(position(r)), squared += position(r).squaredNorm();
    length = std::max(length, truth.norm());
  }
  const double scale = along / squared;
  double sum = 0.0;
  for (const FrameResult& r : results) {
    sum += (origin * testing::SwayPose(static_cast<double>(r.index)).translation() - scale * position(r)).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(results.size())) / length;
}

TEST(Odometry, FollowsASyntheticSceneAndTellsOfItsKeyframes) {
  const auto odometry = MakeOdometry();
  bool checked_active = false;
  std::vector<KeyframePacket> packets;
  for (const Frame& frame : Sway()) {
    const auto result = odometry->Process(frame);
    ASSERT_TRUE(result.ok()) << result.status();
    if (result->keyframe >= 0 && !checked_active) {
      const auto packet = odometry->PacketOf(odometry->KeyframeTrajectory().back().keyframe);
      ASSERT_TRUE(packet.ok()) << packet.status();
      EXPECT_TRUE(packet->still_active);
      EXPECT_GT(packet->points.size(), 100u);
      checked_active = true;
    }
    for (KeyframePacket& packet : odometry->TakePackets()) packets.push_back(std::move(packet));
  }
  odometry->Finish();
  for (KeyframePacket& packet : odometry->TakePackets()) packets.push_back(std::move(packet));
  EXPECT_TRUE(checked_active);
  const std::vector<FrameResult> results = odometry->FrameResults();
  ASSERT_EQ(results.size(), 60u);
  for (const FrameResult& result : results) {
    EXPECT_GE(result.keyframe, 0) << "frame " << result.index;  // those before the start too
    EXPECT_GT(result.quality, 0.5) << "frame " << result.index;
  }
  EXPECT_LT(RelativeError(results), 0.01);

  const std::vector<KeyframePose> keyframes = odometry->KeyframeTrajectory();
  EXPECT_EQ(packets.size(), keyframes.size());
  EXPECT_GE(keyframes.size(), 4u);
  EXPECT_EQ(keyframes.back().frame_index, results.back().index) << "nothing else corrects the last frames";
  int tracked_keyframes = 0;
  for (const KeyframePose& keyframe : keyframes) {
    if (keyframe.reference < 0) continue;
    ++tracked_keyframes;
    EXPECT_LT(keyframe.reference, keyframe.keyframe);
  }
  EXPECT_GE(tracked_keyframes, 2);
  EXPECT_FALSE(odometry->PacketOf(0).ok());
  // Depths of a packet, at the scale of the path.
  const KeyframePacket& packet = packets.front();
  const testing::Scene scene;
  std::vector<double> ratios;
  for (const PacketPoint& point : packet.points) {
    EXPECT_GT(point.variance, 0.0f);
    const double depth = scene.Depth(testing::TestCamera(), testing::SwayPose(static_cast<double>(packet.frame.index)),
                                     Vector2d(point.x_px, point.y_px));
    ratios.push_back(depth * point.inverse_depth);
  }
  std::sort(ratios.begin(), ratios.end());
  const double middle = ratios[ratios.size() / 2];
  EXPECT_LT(ratios[ratios.size() * 9 / 10] / middle, 1.1);
  EXPECT_GT(ratios[ratios.size() / 10] / middle, 0.9);
  EXPECT_EQ(odometry->Process(Sway().front()).status().code(), absl::StatusCode::kFailedPrecondition);
}

TEST(Odometry, TwoRunsAreEqualToTheBit) {
  std::vector<FrameResult> runs[2];
  for (auto& run : runs) {
    const auto odometry = MakeOdometry();
    for (int i = 0; i < 34; ++i) ASSERT_TRUE(odometry->Process(Sway()[i]).ok());
    run = odometry->FrameResults();
  }
  ASSERT_EQ(runs[0].size(), runs[1].size());
  for (std::size_t i = 0; i < runs[0].size(); ++i) {
    EXPECT_EQ(runs[0][i].keyframe, runs[1][i].keyframe);
    EXPECT_EQ(runs[0][i].direct_from_camera.translation(), runs[1][i].direct_from_camera.translation());
    EXPECT_EQ(runs[0][i].direct_from_camera.rotation().coeffs(), runs[1][i].direct_from_camera.rotation().coeffs());
  }
}

TEST(Odometry, StillImagesNeverStartAndSayWhy) {
  const auto odometry = MakeOdometry();
  Frame frame = Sway().front();
  for (int i = 0; i < 15; ++i) {
    frame.index = i;
    frame.time_ns = i * 33'000'000;
    const auto result = odometry->Process(frame);
    ASSERT_TRUE(result.ok());
    EXPECT_EQ(result->state, TrackingState::kInitializing);
    EXPECT_EQ(result->keyframe, -1);
    if (i == 0) continue;
    EXPECT_THAT(result->message, HasSubstr("the camera has not moved enough"));
  }
  EXPECT_TRUE(odometry->KeyframeTrajectory().empty());
}

TEST(Odometry, PureRotationNeverStarts) {
  const auto odometry = MakeOdometry();
  const testing::Scene scene;
  for (int i = 0; i < 20; ++i) {
    const SE3 pose(ExpSO3(Vector3d(0.004 * i, -0.008 * i, 0.005 * i)), Vector3d::Zero());
    const auto result = odometry->Process(scene.Render(testing::TestCamera(), pose, i));
    ASSERT_TRUE(result.ok());
    EXPECT_EQ(result->keyframe, -1) << "frame " << i;
  }
}

TEST(Odometry, LosesBlackFramesAndRecovers) {
  const auto odometry = MakeOdometry();
  int lost = 0;
  for (Frame frame : Sway()) {
    const bool black = frame.index >= 40 && frame.index < 43;
    if (black) frame.image = cv::Mat(frame.image.size(), CV_8UC1, cv::Scalar(0));
    const auto result = odometry->Process(frame);
    ASSERT_TRUE(result.ok());
    lost += result->state == TrackingState::kLost;
    if (black) {
      EXPECT_EQ(result->state, TrackingState::kLost);
      EXPECT_EQ(result->quality, 0.0);
      EXPECT_THAT(result->message, HasSubstr("lost"));
    } else if (frame.index >= 43) {
      EXPECT_EQ(result->state, TrackingState::kGood) << "frame " << frame.index;
    }
  }
  EXPECT_EQ(lost, 3);
  EXPECT_EQ(odometry->Statistics().segments, 1);
  std::vector<FrameResult> tracked = odometry->FrameResults();
  std::erase_if(tracked, [](const FrameResult& r) { return r.keyframe < 0; });
  EXPECT_LT(RelativeError(tracked), 0.015);
}

TEST(Odometry, StartsANewSegmentAfterALongLoss) {
  OdometryOptions options;
  options.max_lost_frames = 3;
  auto odometry = Odometry::Create(options, testing::TestCamera());
  ASSERT_TRUE(odometry.ok());
  std::int64_t index = 0;
  for (int i = 0; i < 30; ++i, ++index) ASSERT_TRUE((*odometry)->Process(Sway()[i]).ok());
  Frame black = Sway().front();
  black.image = cv::Mat(black.image.size(), CV_8UC1, cv::Scalar(0));
  for (int i = 0; i < 4; ++i, ++index) {
    black.index = index;
    black.time_ns = index * 33'333'333;
    ASSERT_TRUE((*odometry)->Process(black).ok());
  }
  for (int i = 34; i < 60; ++i, ++index) ASSERT_TRUE((*odometry)->Process(Sway()[i]).ok());
  (*odometry)->Finish();
  EXPECT_EQ((*odometry)->Statistics().segments, 2);
  const auto keyframes = (*odometry)->KeyframeTrajectory();
  EXPECT_EQ(keyframes.front().segment, 0);
  EXPECT_EQ(keyframes.back().segment, 1);
  EXPECT_EQ((*odometry)->TakePackets().size(), keyframes.size());
}

TEST(Odometry, BadInputIsAnErrorAndChangesNothing) {
  const auto odometry = MakeOdometry();
  Frame frame = Sway().front();
  ASSERT_TRUE(odometry->Process(frame).ok());
  EXPECT_EQ(odometry->Process(frame).status().code(), absl::StatusCode::kInvalidArgument);  // the same index
  frame.index = 1;
  Frame empty = frame;
  empty.image = cv::Mat();
  EXPECT_THAT(std::string(odometry->Process(empty).status().message()), HasSubstr("empty"));
  Frame small = frame;
  small.image = cv::Mat(100, 100, CV_8UC1, cv::Scalar(0));
  EXPECT_THAT(std::string(odometry->Process(small).status().message()), HasSubstr("384 x 288"));
  Frame colour = frame;
  colour.image = cv::Mat::zeros(288, 384, CV_8UC3);
  EXPECT_FALSE(odometry->Process(colour).ok());
  Frame irradiance = frame;
  irradiance.corrected = cv::Mat(288, 384, CV_8UC1, cv::Scalar(0));
  EXPECT_FALSE(odometry->Process(irradiance).ok());
  EXPECT_TRUE(odometry->Process(frame).ok());
  EXPECT_EQ(odometry->FrameResults().size(), 2u);
}

TEST(Odometry, BadOptionsAndCamerasAreRefused) {
  OdometryOptions options;
  options.max_keyframes = 50;
  EXPECT_THAT(std::string(Odometry::Create(options, testing::TestCamera()).status().message()),
              HasSubstr("max_keyframes"));
  Pinhole camera = testing::TestCamera();
  camera.fx_px = 0.0;
  EXPECT_FALSE(Odometry::Create(OdometryOptions(), camera).ok());
  EXPECT_TRUE(OdometryOptions().Validate().ok());
}

TEST(PixelSelector, TakesAboutAsManyAsWantedAndSpreadsThem) {
  const PyramidGeometry geometry = PyramidGeometry::Make(testing::TestCamera(), false, 6, 400);
  ImagePyramid pyramid;
  pyramid.Build(Sway().front(), geometry);
  PixelSelector selector;
  std::vector<SelectedPixel> selected;
  for (int wanted : {300, 800}) {
    selector.Select(pyramid, wanted, 7.0, 4, &selected);
    EXPECT_GT(static_cast<int>(selected.size()), wanted / 2);
    EXPECT_LT(static_cast<int>(selected.size()), wanted * 5 / 4);
    int quadrant[4] = {};
    for (const SelectedPixel& p : selected) {
      EXPECT_GE(p.x, 4);
      EXPECT_LT(p.x, 188);
      EXPECT_GT(pyramid.At(0, p.x, p.y)[3], 4.0f);
      ++quadrant[(p.x >= 96) + 2 * (p.y >= 72)];
    }
    for (int count : quadrant) EXPECT_GT(count, static_cast<int>(selected.size()) / 20);
  }
  Frame flat = Sway().front();
  flat.image = cv::Mat(flat.image.size(), CV_8UC1, cv::Scalar(90));
  pyramid.Build(flat, geometry);
  selector.Select(pyramid, 800, 7.0, 4, &selected);
  EXPECT_TRUE(selected.empty());
}

TEST(StructureAdjustment, DerivativesMatchDifferences) {
  const Pinhole camera = testing::TestCamera();
  const SE3 pose(ExpSO3(Vector3d(0.05, -0.02, 0.1)), Vector3d(0.2, -0.1, 0.05));
  const Vector2d reference(100, 80), observed(110, 75);
  Vector2d residual, by_depth, low, high;
  Eigen::Matrix<double, 2, 6> by_pose;
  ASSERT_TRUE(StructureResidual(camera, reference, 0.7, pose, observed, &residual, &by_pose, &by_depth));
  const double h = 1e-6;
  for (int i = 0; i < 6; ++i) {
    Vector6d step = Vector6d::Zero();
    step[i] = h;
    ASSERT_TRUE(StructureResidual(camera, reference, 0.7, SE3::Exp(-step) * pose, observed, &low, nullptr, nullptr));
    ASSERT_TRUE(StructureResidual(camera, reference, 0.7, SE3::Exp(step) * pose, observed, &high, nullptr, nullptr));
    EXPECT_LT(((high - low) / (2 * h) - by_pose.col(i)).norm(), 1e-4);
  }
  ASSERT_TRUE(StructureResidual(camera, reference, 0.7 - h, pose, observed, &low, nullptr, nullptr));
  ASSERT_TRUE(StructureResidual(camera, reference, 0.7 + h, pose, observed, &high, nullptr, nullptr));
  EXPECT_LT(((high - low) / (2 * h) - by_depth).norm(), 1e-4);
}

TEST(StructureAdjustment, FindsPosesAndDepthsDespiteOutliers) {
  Random random(4);
  StructureProblem problem;
  problem.camera = testing::TestCamera();
  std::vector<SE3> truth = {SE3(ExpSO3(Vector3d(0.01, -0.02, 0.01)), Vector3d(0.1, 0.02, 0)),
                            SE3(ExpSO3(Vector3d(0.02, -0.04, 0.0)), Vector3d(0.22, 0.01, 0.03))};
  std::vector<double> depth;
  problem.observed_px.resize(2);
  for (int i = 0; i < 150; ++i) {
    const Vector2d pixel(random.Uniform(30, 350), random.Uniform(30, 250));
    depth.push_back(random.Uniform(0.3, 1.5));
    problem.reference_px.push_back(pixel);
    problem.inverse_depth.push_back(1.0);
    for (int v = 0; v < 2; ++v) {
      Vector2d error(0.2 * random.Normal(), 0.2 * random.Normal());
      if (i % 20 == 0) error += Vector2d(15, -10);
      const Vector3d point =
          truth[v].rotation() * problem.camera.Unproject(pixel) + depth.back() * truth[v].translation();
      problem.observed_px[v].push_back(problem.camera.Project(point) + error);
    }
  }
  problem.camera_from_reference = {truth[0],
                                   SE3(truth[1].rotation(), truth[1].translation() + Vector3d(0.03, -0.02, 0.01))};
  const StructureReport report = AdjustStructure(50, &problem);
  EXPECT_LT(report.rms_px, 0.6);
  EXPECT_GT(report.inlier_share, 0.9);
  EXPECT_FALSE(report.inlier[20]);
  const double scale = truth[1].translation().norm() / problem.camera_from_reference[1].translation().norm();
  EXPECT_LT((scale * problem.camera_from_reference[1].translation() - truth[1].translation()).norm(), 0.01);
  EXPECT_LT(AngleRad(problem.camera_from_reference[1].rotation().conjugate() * truth[1].rotation()), 0.003);
}

TEST(FeatureStart, BlankImagesHaveTooLittleTexture) {
  OdometryOptions options;
  FeatureStart start(options, testing::TestCamera());
  Frame blank = Sway().front();
  blank.image = cv::Mat(blank.image.size(), CV_8UC1, cv::Scalar(90));
  const StartResult result = start.Add(blank);
  EXPECT_FALSE(result.success);
  EXPECT_THAT(result.message, HasSubstr("too little texture"));
}

// Over a single plane two motions fit every pair of views. The start must find the right one or wait and say why.
struct PlaneCase {
  const char* name;
  Vector3d normal_turn;  // of the plane, from facing the camera
  Vector3d velocity_m;   // per frame
  Vector3d turn_rad;     // per frame
  double distance_m = 4.0;
};

class PlanarStart : public ::testing::TestWithParam<PlaneCase> {};

TEST_P(PlanarStart, FindsTheRightDepthsOrWaitsAndSaysWhy) {
  const PlaneCase& c = GetParam();
  const Matrix3d turned = ExpSO3(c.normal_turn).toRotationMatrix();
  const testing::Scene scene({{Vector3d(0, 0, c.distance_m), turned.col(0), turned.col(1), 40, 40}});
  const Pinhole camera = testing::TestCamera();
  FeatureStart start(OdometryOptions(), camera);
  StartResult result;
  std::vector<std::string> messages;
  int reference = 0;
  Random noise(7);
  for (int i = 0; i < 26 && !result.success; ++i) {
    const SE3 pose(ExpSO3(i * c.turn_rad), i * c.velocity_m);
    Frame frame = scene.Render(camera, pose, i);
    for (int k = 0; k < static_cast<int>(frame.image.total()); ++k) {
      frame.image.data[k] = cv::saturate_cast<unsigned char>(frame.image.data[k] + 2.0 * noise.Normal());
    }
    result = start.Add(frame);
    if (result.new_reference) reference = i;
    if (!result.success) messages.push_back(result.message);
  }
  for (const std::string& message : messages) EXPECT_FALSE(message.empty());
  if (!result.success) {
    EXPECT_THAT(messages.back(), AnyOf(HasSubstr("waiting for"), HasSubstr("not moved enough")));
    return;
  }
  const SE3 reference_pose(ExpSO3(reference * c.turn_rad), reference * c.velocity_m);
  std::vector<double> ratios;
  for (std::size_t p = 0; p < result.reference_px.size(); ++p) {
    ratios.push_back(result.inverse_depth[p] * scene.Depth(camera, reference_pose, result.reference_px[p]));
  }
  std::sort(ratios.begin(), ratios.end());
  const double middle = ratios[ratios.size() / 2];
  EXPECT_LT(ratios[ratios.size() * 9 / 10] / middle, 1.25);  // the other plane is off by more
  EXPECT_GT(ratios[ratios.size() / 10] / middle, 0.75);
}

INSTANTIATE_TEST_SUITE_P(
    Planes, PlanarStart,
    ::testing::Values(PlaneCase{"FacingSideways", {0, 0, 0}, {0.03, 0, 0}, {0, 0, 0}},
                      PlaneCase{"FacingSidewaysTurning", {0, 0, 0}, {0.03, 0.01, 0}, {0.002, -0.006, 0.003}},
                      PlaneCase{"FacingForward", {0, 0, 0}, {0, 0, 0.05}, {0, 0, 0}},
                      PlaneCase{"SlantedSideways", {0, 0.6, 0}, {0.03, 0, 0}, {0, 0, 0}},
                      PlaneCase{"SlantedForward", {0.5, 0.2, 0}, {0.01, 0, 0.04}, {0, -0.003, 0}},
                      PlaneCase{"GroundFromAbove", {-0.9, 0, 0}, {0.01, 0.0, 0.03}, {0, 0.002, 0}},
                      PlaneCase{"FarAway", {0.3, 0, 0}, {0.01, 0, 0}, {0, 0.003, 0}, 30.0}),
    [](const auto& planes) { return planes.param.name; });

}  // namespace
}  // namespace cairn::direct

// Whether an alignment is believed, and how much an image says of the motion.
#include "direct/alignment_check.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "base/random.h"
#include "direct/coarse_tracker.h"
#include "direct/testing_scene.h"

namespace cairn::direct {
namespace {

// A view of the scene with 900 points of known depth, and another one of the same place, both at half resolution.
class AlignmentCheck : public ::testing::Test {
 protected:
  AlignmentCheck() : tracker_(geometry_, 9.0, 20.0) {
    const Pinhole camera = testing::TestCamera();
    ImagePyramid pyramid;
    pyramid.Build(scene_.Render(camera, testing::SwayPose(0), 0), geometry_);
    Random random(3);
    std::vector<ReferencePoint> points;
    for (int i = 0; i < 900; ++i) {
      const double x = random.Uniform(4.0, 187.0), y = random.Uniform(4.0, 139.0);
      const double depth = scene_.Depth(camera, testing::SwayPose(0), Vector2d(2.0 * x + 0.5, 2.0 * y + 0.5));
      points.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(1.0 / depth), 1.0f});
    }
    tracker_.BuildReference(pyramid, points, &reference_);
    frame_ = scene_.Render(camera, testing::SwayPose(8), 8);
  }

  AlignmentAgreement Check(const Frame& frame, const SE3& motion, int reach_px = 0) {
    ImagePyramid pyramid;
    pyramid.Build(frame, geometry_);
    return AgreementOf(matcher_.Match(geometry_, reference_, pyramid, motion, CellGrid::kReference, reach_px));
  }

  const PyramidGeometry geometry_ = PyramidGeometry::Make(testing::TestCamera(), false, 6, 400);
  const testing::Scene scene_;
  const SE3 motion_ = testing::SwayPose(8).Inverse() * testing::SwayPose(0);
  CoarseTracker tracker_;
  TrackingReference reference_;
  CellMatcher matcher_;
  Frame frame_;
};

TEST_F(AlignmentCheck, TellsTheSamePlaceFromAnotherAndCountsWhatIsVisible) {
  EXPECT_GT(Check(frame_, motion_).share(), 0.9);
  Frame darker = frame_;
  darker.image = 0.5 * frame_.image + 20.0;  // gain and offset do not matter
  EXPECT_GT(Check(darker, motion_).share(), 0.9);
  darker.image.colRange(0, 192).setTo(60);
  const double half = Check(darker, motion_).share();
  EXPECT_GT(half, 0.35);
  EXPECT_LT(half, 0.65);
  const SE3 elsewhere(Quaterniond::Identity(), Vector3d(9.0, -0.2, 0.5));
  EXPECT_LT(Check(scene_.Render(testing::TestCamera(), elsewhere, 9), motion_).share(), 0.15);
}

// A pose that is off by five pixels of the half image: the patterns are near, except behind an obstacle.
TEST_F(AlignmentCheck, FindsPatternsNearbyUnlessSomethingStandsBeforeThem) {
  const double focal_px = geometry_.camera[0].fx_px;
  const SE3 off = SE3(ExpSO3(Vector3d(5.0 / focal_px, -4.0 / focal_px, 0.0)), Vector3d::Zero()) * motion_;
  EXPECT_LT(Check(frame_, off).share(), 0.5);
  EXPECT_GT(Check(frame_, off, 3).share(), 0.9);
  Frame covered = frame_;
  covered.image = frame_.image.clone();
  for (int y = 0; y < 288; ++y) {
    for (int x = 0; x < 192; ++x) {
      covered.image.at<unsigned char>(y, x) =
          static_cast<unsigned char>(30.0 + 150.0 * testing::ValueNoise(0.08 * x, 0.08 * y, 99));
    }
  }
  ImagePyramid pyramid;
  pyramid.Build(covered, geometry_);
  const CellMatches matches = matcher_.Match(geometry_, reference_, pyramid, off, CellGrid::kImage, 3);
  int found = 0, hidden = 0;
  for (int k = 0; k < kCellColumns * kCellRows; ++k) {
    const CellMatch& match = matches[static_cast<std::size_t>(k)];
    if (!match.known) continue;
    (k % kCellColumns < kCellColumns / 2 ? hidden : found) += match.correlation >= kAgreeingCorrelation;
  }
  EXPECT_GE(found, 20);  // of 24
  EXPECT_LE(hidden, 4);  // smooth patterns resemble each other
  const CellMatches farther = matcher_.Match(
      geometry_, reference_, pyramid, SE3(ExpSO3(Vector3d(0.0, -20.0 / focal_px, 0.0)), Vector3d::Zero()) * motion_,
      CellGrid::kImage, 3);
  EXPECT_LE(std::count_if(farther.begin(), farther.end(),
                          [](const CellMatch& match) { return match.correlation >= kAgreeingCorrelation; }),
            4);
}

// Stripes say nothing of a motion along them.
TEST_F(AlignmentCheck, TheUncertaintyOfAMotionIsThatOfItsWeakestDirection) {
  const auto sigma_px = [&](const Frame& frame) {
    FrameData data;
    data.frame = frame;
    data.pyramid.Build(frame, geometry_);
    std::vector<ReferencePoint> points;
    for (int y = 6; y < 138; y += 4) {
      for (int x = 6; x < 186; x += 4) points.push_back({static_cast<float>(x), static_cast<float>(y), 0.3f, 1.0f});
    }
    TrackingReference reference;
    tracker_.BuildReference(data.pyramid, points, &reference);
    const double never[kMaxLevels] = {};
    double rms[kMaxLevels];
    return tracker_.Align(reference, data, {SE3(), 2.0}, AffineLight(), LightPrior(), never, rms).weakest_sigma_px;
  };
  Frame stripes = frame_, blank = frame_;
  stripes.image = frame_.image.clone();
  for (int y = 1; y < stripes.image.rows; ++y) stripes.image.row(0).copyTo(stripes.image.row(y));
  blank.image = cv::Mat(frame_.image.size(), CV_8UC1, cv::Scalar(120));
  EXPECT_LT(sigma_px(frame_), 0.3);
  EXPECT_GT(sigma_px(stripes), 4.0);
  EXPECT_GT(sigma_px(blank), 100.0);
}

}  // namespace
}  // namespace cairn::direct

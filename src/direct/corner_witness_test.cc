// What corners say of poses that nothing else bears out: the truth, poses a little off, and images that show nothing.
#include "direct/corner_witness.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "direct/testing_scene.h"

namespace cairn::direct {
namespace {

constexpr int kReference = 20;
constexpr double kNoisePx = 0.1;

Frame FrameAt(int i, double blur_px = 0.0) {
  static const testing::Scene scene;
  Frame frame = scene.Render(testing::TestCamera(), testing::SwayPose(i), i);
  if (blur_px > 0.0) cv::GaussianBlur(frame.image, frame.image, cv::Size(), blur_px, 0.5);
  return frame;
}

SE3 FromReference(int i) { return testing::SwayPose(i).Inverse() * testing::SwayPose(kReference); }

// Frames before the reference that are borne out, of ten; `off` is what is wrong about the last five.
int BorneOut(const SE3& off, double blur_px = 0.0) {
  CornerWitness witness(OdometryOptions(), testing::TestCamera(), FrameAt(kReference), kNoisePx);
  for (int back = 1; back <= 10; ++back) {
    const int i = kReference - back;
    const SE3 pose = FromReference(i);
    if (!witness.BearsOut(FrameAt(i, back > 5 ? blur_px : 0.0), back > 5 ? off * pose : pose)) return back - 1;
  }
  return 10;
}

TEST(CornerWitness, BearsOutTheTruth) { EXPECT_EQ(BorneOut(SE3()), 10); }

// By a pixel and a half, and so far that it shows a shift for a turn: what an image out of focus may fit as well.
TEST(CornerWitness, ContradictsPosesThatAreALittleOff) {
  const double angle_rad = 3.0 / testing::TestCamera().fx_px;
  EXPECT_LT(BorneOut(SE3(ExpSO3(Vector3d(angle_rad, 0, 0)), Vector3d::Zero())), 10);
  EXPECT_GE(BorneOut(SE3(ExpSO3(Vector3d(angle_rad, 0, 0)), Vector3d::Zero())), 5);
}

// Something passes through the view from side to side and takes all corners along.
TEST(CornerWitness, FollowsOthersWhereTheFirstAreTakenAlong) {
  CornerWitness witness(OdometryOptions(), testing::TestCamera(), FrameAt(kReference), kNoisePx);
  for (int back = 1; back <= 10; ++back) {
    const int i = kReference - back;
    Frame frame = FrameAt(i);
    const int width = frame.image.cols / 4;
    frame.image.colRange((back - 1) % 4 * width, ((back - 1) % 4 + 1) * width).setTo(90);
    EXPECT_TRUE(witness.BearsOut(frame, FromReference(i))) << back;
  }
}

TEST(CornerWitness, SaysNothingOfImagesWithoutCorners) {
  CornerWitness witness(OdometryOptions(), testing::TestCamera(), FrameAt(kReference), kNoisePx);
  Frame black = FrameAt(kReference - 1);
  black.image.setTo(0);
  EXPECT_FALSE(witness.BearsOut(black, FromReference(kReference - 1)));
  CornerWitness blind(OdometryOptions(), testing::TestCamera(), black, kNoisePx);
  EXPECT_FALSE(blind.BearsOut(FrameAt(kReference - 2), SE3()));
}

}  // namespace
}  // namespace cairn::direct

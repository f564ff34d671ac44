#include "direct/frame_spread.h"

#include <gtest/gtest.h>

#include <vector>

namespace cairn::direct {
namespace {

SE3 Along(double x, double turn_rad) { return {ExpSO3(Vector3d(0.0, turn_rad, 0.0)), Vector3d(x, 0.1 * x * x, 0.0)}; }

double Distance(const SE3& a, const SE3& b) {
  return (a.translation() - b.translation()).norm() + AngleRad(a.rotation() * b.rotation().conjugate());
}

FrameResult Frame(TimeNs time_ns, std::int64_t keyframe, const SE3& keyframe_from_camera) {
  FrameResult frame;
  frame.time_ns = time_ns;
  frame.keyframe = keyframe;
  frame.keyframe_from_camera = keyframe_from_camera;
  return frame;
}

// Keyframes at times 0, 100, 200; tracking saw the camera at Along(t / 100, t / 1000), and optimization has moved the
// second and third. The third was tracked against `third_reference`.
std::vector<KeyframePose> Keyframes(std::int64_t third_reference) {
  std::vector<KeyframePose> keyframes(3);
  for (std::int64_t k = 0; k < 3; ++k) {
    keyframes[k].keyframe = k;
    keyframes[k].time_ns = 100 * k;
  }
  const SE3 first = Along(0.0, 0.0), second = Along(1.0, 0.1), third = Along(2.0, 0.2);
  keyframes[0].direct_from_camera = SE3(ExpSO3(Vector3d(0.3, 0.0, 0.0)), Vector3d(5.0, 0.0, 0.0));
  keyframes[1].reference = 0;
  keyframes[1].reference_from_camera = first.Inverse() * second;
  keyframes[1].direct_from_camera = keyframes[0].direct_from_camera * Along(1.2, 0.08);
  keyframes[2].reference = third_reference;
  keyframes[2].reference_from_camera = (third_reference == 0 ? first : second).Inverse() * third;
  keyframes[2].direct_from_camera = keyframes[0].direct_from_camera * Along(2.3, 0.25);
  return keyframes;
}

TEST(FrameSpread, FramesFollowBothKeyframes) {
  const auto keyframes = Keyframes(1);
  const SE3 optimized = keyframes[0].direct_from_camera.Inverse() * keyframes[1].direct_from_camera;
  FrameResult at_begin = Frame(1, 0, Along(0.01, 0.001)), at_end = Frame(99, 0, Along(0.99, 0.099));
  SpreadCorrection(keyframes, &at_begin);
  SpreadCorrection(keyframes, &at_end);
  EXPECT_LT(Distance(at_begin.keyframe_from_camera, Along(0.01, 0.001)), 0.005);
  EXPECT_LT(Distance(at_end.keyframe_from_camera, optimized), 0.02);
  EXPECT_GT(Distance(at_end.keyframe_from_camera, Along(0.99, 0.099)), 0.1);
}

TEST(FrameSpread, FramesTrackedAgainstAnOlderKeyframeGoOver) {
  for (const std::int64_t third_reference : {0, 1}) {
    const auto keyframes = Keyframes(third_reference);
    // Just after the second keyframe, but still tracked against the first.
    FrameResult late = Frame(101, 0, Along(1.01, 0.101));
    SpreadCorrection(keyframes, &late);
    EXPECT_EQ(late.keyframe, 1);
    EXPECT_LT(late.keyframe_from_camera.translation().norm(), 0.03) << third_reference;
    // Just before the third it meets the third.
    FrameResult last = Frame(199, 0, Along(1.99, 0.199));
    SpreadCorrection(keyframes, &last);
    EXPECT_EQ(last.keyframe, 1);
    const SE3 optimized = keyframes[1].direct_from_camera.Inverse() * keyframes[2].direct_from_camera;
    EXPECT_LT(Distance(last.keyframe_from_camera, optimized), 0.02) << third_reference;
  }
  // After the last keyframe there is nothing to spread.
  FrameResult after = Frame(210, 2, Along(0.1, 0.01));
  SpreadCorrection(Keyframes(1), &after);
  EXPECT_LT(Distance(after.keyframe_from_camera, Along(0.1, 0.01)), 1e-12);
}

TEST(FrameSpread, LeavesAloneWhatItKnowsNothingAbout) {
  auto keyframes = Keyframes(1);
  keyframes[1].reference = -1;
  for (const TimeNs time_ns : {50, 150}) {
    FrameResult frame = Frame(time_ns, 0, Along(0.5, 0.05));
    SpreadCorrection(keyframes, &frame);
    EXPECT_EQ(frame.keyframe, 0);
    EXPECT_LT(Distance(frame.keyframe_from_camera, Along(0.5, 0.05)), 1e-12);
  }
  FrameResult lost = Frame(50, -1, SE3());
  SpreadCorrection(keyframes, &lost);
  EXPECT_EQ(lost.keyframe, -1);
  // Before its keyframe: frames that waited for the start, tracked backwards.
  FrameResult before = Frame(-10, 0, Along(-0.1, 0.0));
  SpreadCorrection(Keyframes(1), &before);
  EXPECT_LT(Distance(before.keyframe_from_camera, Along(-0.1, 0.0)), 1e-12);
}

}  // namespace
}  // namespace cairn::direct

#include "mapping/direct_trajectory.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "base/random.h"
#include "map/testing_map.h"

namespace cairn::mapping {
namespace {

const Sim3 kMapFromDirect(ExpSO3(Vector3d(0.4, -0.2, 0.9)), Vector3d(3, 1, -2), 2.5);

// A camera that rolls along a straight line: positions alone would leave it free to turn about the line.
std::vector<TrajectoryKeyframe> StraightLine(int count, std::int64_t segment, const Sim3& map_from_direct) {
  std::vector<TrajectoryKeyframe> keyframes;
  for (int i = 0; i < count; ++i) {
    TrajectoryKeyframe keyframe;
    keyframe.direct_keyframe = i + 100 * segment;
    keyframe.segment = segment;
    keyframe.time_ns = keyframe.direct_keyframe * 100000000;
    keyframe.direct_from_camera = SE3(ExpSO3(Vector3d(0.0, 0.0, 0.05 * i)), Vector3d(0.0, 0.0, 0.3 * i));
    keyframe.map_from_camera = map_from_direct.TransformPose(keyframe.direct_from_camera);
    keyframe.located = true;
    keyframes.push_back(keyframe);
  }
  return keyframes;
}

double Distance(const SE3& a, const SE3& b) {
  return (a.translation() - b.translation()).norm() + AngleRad(a.rotation() * b.rotation().conjugate());
}

// Each segment as a stretch.
std::vector<TrajectoryKeyframe> DirectTrajectory(const std::vector<TrajectoryKeyframe>& refined) {
  std::vector<Stretch> segments;
  for (std::size_t begin = 0, end = 0; begin < refined.size(); begin = end) {
    while (end < refined.size() && refined[end].segment == refined[begin].segment) ++end;
    segments.push_back({begin, end});
  }
  return WithDirectStretches(refined, segments);
}

TEST(DirectStretches, FindsTheExactSimilarityOnAStraightLine) {
  std::vector<TrajectoryKeyframe> refined = StraightLine(20, 0, kMapFromDirect);
  refined[7].located = false;
  refined[7].map_from_camera = SE3();
  const std::vector<TrajectoryKeyframe> direct = DirectTrajectory(refined);
  ASSERT_EQ(direct.size(), refined.size());
  for (const TrajectoryKeyframe& keyframe : direct) {
    EXPECT_TRUE(keyframe.located);
    EXPECT_NEAR(keyframe.map_per_direct, kMapFromDirect.scale(), 1e-9);
    EXPECT_LT(Distance(keyframe.map_from_camera, kMapFromDirect.TransformPose(keyframe.direct_from_camera)), 1e-9);
  }
  // Frames between keyframes follow.
  direct::FrameResult frame;
  frame.keyframe = 3;
  frame.time_ns = 350000000;
  frame.keyframe_from_camera = SE3(Quaterniond::Identity(), Vector3d(0.02, 0.0, 0.15));
  const auto pose = PoseOfFrame(direct, frame);
  ASSERT_TRUE(pose.has_value());
  const SE3 expected = kMapFromDirect.TransformPose(direct[3].direct_from_camera * frame.keyframe_from_camera);
  EXPECT_LT(Distance(*pose, expected), 1e-9);
}

TEST(DirectStretches, KeepsTheShapeOfTheDirectOne) {
  std::vector<TrajectoryKeyframe> refined = StraightLine(30, 0, kMapFromDirect);
  Random random(5);
  for (TrajectoryKeyframe& keyframe : refined) {
    Vector6d x;
    for (int i = 0; i < 6; ++i) x[i] = 0.05 * random.Normal();
    keyframe.map_from_camera = keyframe.map_from_camera * SE3::Exp(x);
  }
  const std::vector<TrajectoryKeyframe> direct = DirectTrajectory(refined);
  double farthest = 0.0;
  for (std::size_t i = 0; i < direct.size(); ++i) {
    const SE3 exact = kMapFromDirect.TransformPose(direct[i].direct_from_camera);
    farthest = std::max(farthest, Distance(direct[i].map_from_camera, exact));
    if (i == 0) continue;
    const double step = (direct[i].map_from_camera.translation() - direct[i - 1].map_from_camera.translation()).norm();
    EXPECT_NEAR(step, 0.3 * direct[i].map_per_direct, 1e-9);
  }
  EXPECT_LT(farthest, 0.1);
}

TEST(DirectStretches, PlacesEachSegmentByItself) {
  const Sim3 other(ExpSO3(Vector3d(-0.3, 0.1, 0.2)), Vector3d(0, 7, 0), 0.4);
  std::vector<TrajectoryKeyframe> refined = StraightLine(6, 0, kMapFromDirect);
  for (const TrajectoryKeyframe& keyframe : StraightLine(6, 1, other)) refined.push_back(keyframe);
  // Too short to be placed: stays as it is.
  for (const TrajectoryKeyframe& keyframe : StraightLine(2, 2, other)) refined.push_back(keyframe);
  refined.back().map_from_camera = SE3(Quaterniond::Identity(), Vector3d(9, 9, 9));
  const std::vector<TrajectoryKeyframe> direct = DirectTrajectory(refined);
  EXPECT_NEAR(direct[2].map_per_direct, kMapFromDirect.scale(), 1e-9);
  EXPECT_NEAR(direct[8].map_per_direct, other.scale(), 1e-9);
  for (std::size_t i = 0; i < direct.size(); ++i) {
    EXPECT_LT(Distance(direct[i].map_from_camera, refined[i].map_from_camera), 1e-9) << i;
  }
  EXPECT_TRUE(DirectTrajectory({}).empty());
}

// The refined keyframes of the stretch have noise: it keeps the direct shape, and hangs on what is beside it without a
// break, on both sides or at an end.
TEST(DirectStretches, HangOnTheRefinedKeyframesBesideThem) {
  std::vector<TrajectoryKeyframe> exact = StraightLine(30, 0, kMapFromDirect);
  for (TrajectoryKeyframe& keyframe : exact) keyframe.map_per_direct = kMapFromDirect.scale();
  for (const Stretch stretch : {Stretch{10, 20}, Stretch{20, 30}, Stretch{0, 10}}) {
    std::vector<TrajectoryKeyframe> refined = exact;
    Random random(6);
    double noise = 0.0, left = 0.0;
    for (std::size_t i = stretch.begin; i < stretch.end; ++i) {
      Vector6d x;
      for (int k = 0; k < 6; ++k) x[k] = 0.02 * random.Normal();
      refined[i].map_from_camera = refined[i].map_from_camera * SE3::Exp(x);
      noise += Distance(refined[i].map_from_camera, exact[i].map_from_camera);
    }
    const std::vector<TrajectoryKeyframe> mixed = WithDirectStretches(refined, std::vector{stretch});
    for (std::size_t i = 0; i < refined.size(); ++i) {
      if (i < stretch.begin || i >= stretch.end) {
        EXPECT_LT(Distance(mixed[i].map_from_camera, refined[i].map_from_camera), 1e-12) << i;
      } else {
        left += Distance(mixed[i].map_from_camera, exact[i].map_from_camera);
      }
    }
    EXPECT_LT(left, 0.3 * noise) << stretch.begin;
  }
}

TEST(DirectRotations, AreBetweenTheKeyframesOfTheMapThatFollowEachOther) {
  const auto map = map::testing::MakeMap(1, 2, 50).snapshot;
  ASSERT_GE(map->keyframes().size(), 2u);
  std::vector<KeyframeTrajectory::Entry> entries(7);
  for (std::size_t i = 0; i < entries.size(); ++i) {
    entries[i].segment = i < 5 ? 0 : 1;
    entries[i].direct_from_camera = SE3(ExpSO3(Vector3d(0.0, 0.1 * static_cast<double>(i), 0.0)), Vector3d::Zero());
  }
  entries[1].keyframe = KeyframeId(1);
  entries[2].keyframe = KeyframeId(999);  // not in the map any more
  entries[4].keyframe = KeyframeId(2);
  entries[6].keyframe = KeyframeId(1);  // of another segment
  const std::vector<KeyframeRotation> rotations = DirectRotations(entries, *map);
  ASSERT_EQ(rotations.size(), 1u);
  EXPECT_EQ(rotations[0].a, KeyframeId(1));
  EXPECT_EQ(rotations[0].b, KeyframeId(2));
  EXPECT_EQ(rotations[0].steps, 3);
  EXPECT_LT(AngleRad(rotations[0].b_from_a * ExpSO3(Vector3d(0.0, 0.3, 0.0))), 1e-9);
}

}  // namespace
}  // namespace cairn::mapping

// The small parts that couple the direct module with the map: depths of keypoints, relative scale, trajectories.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "base/random.h"
#include "map/testing_map.h"
#include "mapping/collinearity.h"
#include "mapping/keyframe_trajectory.h"
#include "mapping/keypoint_depth.h"

namespace cairn::mapping {
namespace {

TEST(KeypointDepth, IsTheInverseVarianceMeanWithinTwoPixels) {
  const std::vector<image::Keypoint> keypoints = {{100.0f, 100.0f, 0.0f, 0}, {200.0f, 100.0f, 0.0f, 0}};
  const std::vector<direct::PacketPoint> points = {
      {101.0f, 100.0f, 0.50f, 1e-4f}, {100.0f, 101.5f, 0.53f, 4e-4f}, {103.0f, 100.0f, 0.9f, 1e-6f}};
  const auto depths = KeypointDepths(keypoints, points);
  ASSERT_EQ(depths.size(), 2u);
  EXPECT_NEAR(depths[0].inverse_depth, (0.50 / 1e-4 + 0.53 / 4e-4) / (1 / 1e-4 + 1 / 4e-4), 1e-6);
  EXPECT_NEAR(depths[0].variance, 1.0 / (1 / 1e-4 + 1 / 4e-4), 1e-9);
  EXPECT_FALSE(depths[1].known()) << "nothing near";
}

TEST(KeypointDepth, RejectsEdgesUncertaintyAndNonsense) {
  const std::vector<image::Keypoint> keypoints = {
      {50.0f, 50.0f, 0.0f, 0}, {100.0f, 50.0f, 0.0f, 0}, {150.0f, 50.0f, 0.0f, 0}};
  const std::vector<direct::PacketPoint> points = {{50.0f, 50.0f, 0.5f, 1e-5f},   {51.0f, 50.0f, 0.8f, 1e-5f},
                                                   {100.0f, 50.0f, 0.5f, 0.01f},  {150.0f, 50.0f, NAN, 1e-5f},
                                                   {150.0f, 50.0f, -0.5f, 1e-5f}, {150.0f, 50.0f, 0.5f, 0.0f}};
  for (const KeypointDepth& depth : KeypointDepths(keypoints, points)) EXPECT_FALSE(depth.known());
  EXPECT_FALSE(KeypointDepths(keypoints, {})[0].known());
}

TEST(Collinearity, LinksAlongALineAndAcross) {
  const Vector3d centre(1, 2, 3);
  const auto at = [&](double degrees) {
    const double angle = degrees * 3.14159265358979 / 180.0;
    return Vector3d(centre + 2.0 * Vector3d(std::cos(angle), std::sin(angle), 0));
  };
  EXPECT_TRUE(LinksAreCollinear(centre, {}));
  EXPECT_TRUE(LinksAreCollinear(centre, std::vector{at(0)}));
  EXPECT_TRUE(LinksAreCollinear(centre, std::vector{at(0), at(180), at(20), at(175)}));
  EXPECT_FALSE(LinksAreCollinear(centre, std::vector{at(0), at(31)}));
  EXPECT_FALSE(LinksAreCollinear(centre, std::vector{at(0), at(149)}));
  EXPECT_TRUE(LinksAreCollinear(centre, std::vector{at(0), at(151)}));
}

TEST(Collinearity, CountsTheKeyframesOfAStraightPath) {
  const auto world = map::testing::MakeMap(3, 16, 1500);  // cameras on a line
  CollinearityCounter counter;
  for (KeyframeId::Value id = 1; id <= 16; ++id) counter.Update(*world.snapshot, KeyframeId(id));
  EXPECT_EQ(counter.keyframes(), 16);
  EXPECT_EQ(counter.collinear(), 6) << "but for the first ten";
}

// Keyframes 0 to 4 on a line, one second and one metre apart; the direct module measures in units of half a metre. 0
// and 4 are in the map, 4 was refined to 0.2 m off the line.
TEST(KeyframeTrajectory, FillsGapsByScaledDirectMotion) {
  auto world = map::testing::MakeMap(4, 2, 200);
  map::Edit edit(world.snapshot);
  edit.SetPose(KeyframeId(1), SE3());
  edit.SetPose(KeyframeId(2), SE3(Quaterniond::Identity(), Vector3d(-4.0, -0.2, 0)));
  const auto map = *world.snapshot->Apply(edit.Finish("move"));
  KeyframeTrajectory trajectory;
  for (int i = 0; i < 6; ++i) {
    KeyframeTrajectory::Entry entry;
    entry.direct_keyframe = i;
    entry.segment = i < 5 ? 0 : 1;
    entry.time_ns = FromSeconds(i);
    entry.direct_from_camera = SE3(Quaterniond::Identity(), Vector3d(2.0 * i, 0, 0));
    if (i == 0 || i == 4) {
      entry.keyframe = entry.reference = KeyframeId(i == 0 ? 1 : 2);
      entry.map_per_direct = 0.5;
    }
    trajectory.Add(entry);
  }
  auto resolved = trajectory.Resolve(*map);
  ASSERT_EQ(resolved.size(), 6u);
  for (int i = 0; i < 5; ++i) {
    EXPECT_TRUE(resolved[i].located);
    EXPECT_LT((resolved[i].map_from_camera.translation() - Vector3d(i, 0.05 * i, 0)).norm(), 1e-9) << i;
    EXPECT_EQ(resolved[i].map_per_direct, 0.5);
  }
  EXPECT_FALSE(resolved[5].located) << "another segment, never located";

  direct::FrameResult frame;
  frame.keyframe = 1;
  frame.time_ns = FromSeconds(1.5);
  frame.keyframe_from_camera = SE3(Quaterniond::Identity(), Vector3d(1.0, 0, 0));
  const auto pose = PoseOfFrame(resolved, frame);
  ASSERT_TRUE(pose);
  EXPECT_LT((pose->translation() - Vector3d(1.5, 0.075, 0)).norm(), 1e-9);
  frame.keyframe = 5;
  EXPECT_FALSE(PoseOfFrame(resolved, frame));
  frame.keyframe = -1;
  EXPECT_FALSE(PoseOfFrame(resolved, frame));

  // A packet of a keyframe that was still active: its pose is another one at the end, and the frames hang on that.
  trajectory.ReviseDirectPoses({{2, SE3(Quaterniond::Identity(), Vector3d(4.4, 0, 0))}});
  const auto revised = trajectory.Resolve(*map);
  EXPECT_EQ(revised[1].direct_from_camera.translation(), resolved[1].direct_from_camera.translation());
  EXPECT_EQ(revised[2].direct_from_camera.translation(), Vector3d(4.4, 0, 0));
  frame.keyframe = 1;
  frame.time_ns = FromSeconds(2.0) - 1;
  frame.keyframe_from_camera = SE3(Quaterniond::Identity(), Vector3d(2.4, 0, 0));
  const auto at_end = PoseOfFrame(revised, frame);
  ASSERT_TRUE(at_end);
  EXPECT_LT((at_end->translation() - revised[2].map_from_camera.translation()).norm(), 1e-6);

  // Culled: what hung on it moves to its heir and stays where it was.
  trajectory.Reattach(
      KeyframeId(2), KeyframeId(1),
      map->keyframe(KeyframeId(1)).camera_from_map * map->keyframe(KeyframeId(2)).camera_from_map.Inverse());
  resolved = trajectory.Resolve(*map);
  EXPECT_FALSE(resolved[4].keyframe);
  EXPECT_LT((resolved[4].map_from_camera.translation() - Vector3d(4.0, 0.2, 0)).norm(), 1e-9);
}

}  // namespace
}  // namespace cairn::mapping

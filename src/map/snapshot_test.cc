#include "map/snapshot.h"

#include <gtest/gtest.h>

#include "map/testing_map.h"

namespace cairn::map {
namespace {

using testing::MakeMap;
using testing::TestMap;

TEST(Snapshot, StartsEmpty) {
  const auto map = Snapshot::Empty(MapInfo{});
  EXPECT_EQ(map->revision(), 0u);
  EXPECT_TRUE(map->keyframes().empty());
  EXPECT_EQ(map->next_keyframe(), KeyframeId(1));
  EXPECT_TRUE(map->CheckConsistency().ok());
}

TEST(Snapshot, OldRevisionsStayAsTheyWere) {
  const TestMap world = MakeMap(1, 3, 100);
  Edit edit(world.snapshot);
  edit.SetPose(KeyframeId(2), SE3());
  const auto next = world.snapshot->Apply(edit.Finish("move"));
  ASSERT_TRUE(next.ok());
  EXPECT_EQ((*next)->revision(), world.snapshot->revision() + 1);
  EXPECT_EQ((*next)->keyframe(KeyframeId(2)).camera_from_map.translation(), Vector3d::Zero());
  EXPECT_NE(world.snapshot->keyframe(KeyframeId(2)).camera_from_map.translation(), Vector3d::Zero());
  EXPECT_EQ((*next)->keyframes().FindPointer(KeyframeId(3)), world.snapshot->keyframes().FindPointer(KeyframeId(3)))
      << "what did not change is shared";
}

TEST(Snapshot, RefusesADeltaOfAnotherRevision) {
  const TestMap world = MakeMap(2, 2, 50);
  Delta delta;
  delta.base = world.snapshot->revision() + 1;
  EXPECT_EQ(world.snapshot->Apply(delta).status().code(), absl::StatusCode::kFailedPrecondition);
}

// Deltas as a damaged file or a bad peer might send them.
TEST(Snapshot, RefusesDeltasThatDoNotResolve) {
  const TestMap world = MakeMap(3, 3, 100);
  const Snapshot& map = *world.snapshot;
  const auto refused = [&](Delta delta) {
    delta.base = map.revision();
    delta.next_keyframe = map.next_keyframe();
    delta.next_point = map.next_point();
    return map.Apply(delta).status().code() == absl::StatusCode::kInvalidArgument;
  };
  Delta delta;
  delta.removed_points = {PointId(100000)};
  EXPECT_TRUE(refused(delta));
  delta = {};
  delta.removed_keyframes = {KeyframeId(9)};
  EXPECT_TRUE(refused(delta));
  delta = {};
  delta.keyframes = {nullptr};
  EXPECT_TRUE(refused(delta));
  delta = {};
  delta.points = {std::make_shared<MapPoint>()};
  EXPECT_TRUE(refused(delta)) << "no id";

  auto keyframe = std::make_shared<Keyframe>(map.keyframe(KeyframeId(2)));
  keyframe->id = map.next_keyframe();
  delta = {};
  delta.keyframes = {keyframe};
  EXPECT_TRUE(refused(delta)) << "an id that is not given out";
  keyframe = std::make_shared<Keyframe>(map.keyframe(KeyframeId(2)));
  keyframe->camera = CameraId(7);
  delta.keyframes = {keyframe};
  EXPECT_TRUE(refused(delta));
  keyframe = std::make_shared<Keyframe>(map.keyframe(KeyframeId(2)));
  keyframe->points.pop_back();
  delta.keyframes = {keyframe};
  EXPECT_TRUE(refused(delta));
  keyframe = std::make_shared<Keyframe>(map.keyframe(KeyframeId(2)));
  keyframe->parent = KeyframeId(3);
  delta.keyframes = {keyframe};
  EXPECT_TRUE(refused(delta)) << "not in the parent's list";
  keyframe = std::make_shared<Keyframe>(map.keyframe(KeyframeId(2)));
  keyframe->covisible.pop_back();
  keyframe->covisible.push_back({KeyframeId(1), 10000});
  delta.keyframes = {keyframe};
  EXPECT_TRUE(refused(delta)) << "covisibility that only one side knows";

  PointId any;
  map.points().ForEach([&](const std::shared_ptr<const MapPoint>& p) { any = p->id; });
  auto point = std::make_shared<MapPoint>(map.point(any));
  point->position.x() = std::nan("");
  delta = {};
  delta.points = {point};
  EXPECT_TRUE(refused(delta));
  point = std::make_shared<MapPoint>(map.point(any));
  point->observations[0].feature += 1;
  delta.points = {point};
  EXPECT_TRUE(refused(delta));
  point = std::make_shared<MapPoint>(map.point(any));
  point->observations.clear();
  delta.points = {point};
  EXPECT_TRUE(refused(delta));
  EXPECT_TRUE(map.CheckConsistency().ok());
}

TEST(Snapshot, BestCovisibleFallsBackToTheBestThereIs) {
  Keyframe keyframe;
  EXPECT_TRUE(BestCovisible(keyframe).empty());
  keyframe.covisible = {{KeyframeId(3), 12}, {KeyframeId(2), 9}};
  EXPECT_EQ(BestCovisible(keyframe), (std::vector<KeyframeId>{KeyframeId(3)}));
  keyframe.covisible = {{KeyframeId(4), 120}, {KeyframeId(3), 15}, {KeyframeId(2), 9}};
  EXPECT_EQ(BestCovisible(keyframe), (std::vector<KeyframeId>{KeyframeId(4), KeyframeId(3)}));
  EXPECT_EQ(BestCovisible(keyframe, 1), (std::vector<KeyframeId>{KeyframeId(4)}));
  EXPECT_EQ(BestCovisible(keyframe, 0, 100), (std::vector<KeyframeId>{KeyframeId(4)}));
}

}  // namespace
}  // namespace cairn::map

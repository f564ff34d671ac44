#include "map/snapshot.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "map/region.h"
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

// As a whole map comes from a file or over the network.
TEST(Snapshot, RefusesWholeMapsWhoseKeyframesAndPointsDisagree) {
  const TestMap world = MakeMap(5, 3, 100);
  const auto nothing = Snapshot::Empty(world.snapshot->info(), world.snapshot->revision() - 1);
  const Delta all = AllOf(*world.snapshot);
  ASSERT_TRUE(nothing->Apply(all).ok());

  // A feature of the second keyframe that has a point, which the third sees, too.
  const Keyframe& second = world.snapshot->keyframe(KeyframeId(2));
  std::uint32_t feature = 0;
  while (!second.points[feature] || world.snapshot->point(second.points[feature]).observations.size() < 3) ++feature;
  const PointId seen = second.points[feature];
  const auto with_point = [&](PointId point, std::uint32_t at) {
    Delta changed = all;
    auto keyframe = std::make_shared<Keyframe>(second);
    keyframe->points[at] = point;
    changed.keyframes[1] = std::move(keyframe);
    return nothing->Apply(changed).status();
  };
  EXPECT_TRUE(with_point(seen, feature).ok());
  std::uint32_t other = 0;
  while (other == feature || !second.points[other]) ++other;
  EXPECT_FALSE(with_point(PointId(), feature).ok()) << "a point has an observation that its keyframe has not";
  EXPECT_FALSE(with_point(second.points[other], feature).ok()) << "one of another feature";
  EXPECT_FALSE(with_point(PointId(99999), feature).ok()) << "one that is not there";

  // A point that does not know of a keyframe that observes it, though all that it knows is true.
  Delta changed = all;
  const auto at = std::ranges::find(all.points, seen, [](const auto& point) { return point->id; }) - all.points.begin();
  auto point = std::make_shared<MapPoint>(*all.points[at]);
  std::erase_if(point->observations, [](const Observation& o) { return o.keyframe == KeyframeId(2); });
  point->reference = point->observations.front();
  changed.points[at] = std::move(point);
  const absl::Status status = nothing->Apply(changed).status();
  EXPECT_FALSE(status.ok());
  EXPECT_NE(status.message().find("does not know"), std::string::npos) << status;
}

// What was removed must have been unlinked by whoever removed it: a map that is committed can be loaded again.
TEST(Snapshot, RefusesToLeaveReferencesToWhatIsRemoved) {
  const TestMap world = MakeMap(4, 4, 120);
  const Snapshot& map = *world.snapshot;
  const auto refused = [&](Delta delta) {
    delta.base = map.revision();
    delta.next_keyframe = map.next_keyframe();
    delta.next_point = map.next_point();
    return map.Apply(delta).status().code() == absl::StatusCode::kInvalidArgument;
  };
  PointId any;
  map.points().ForEach([&](const std::shared_ptr<const MapPoint>& p) { any = p->id; });
  Delta delta;
  delta.removed_points = {any};
  EXPECT_TRUE(refused(delta)) << "keyframes observe it";
  delta = {};
  delta.removed_keyframes = {KeyframeId(4)};
  EXPECT_TRUE(refused(delta)) << "points, a parent and neighbours refer to it";
  delta = {};
  delta.removed_cameras = {world.camera};
  EXPECT_TRUE(refused(delta)) << "keyframes were taken with it";
  delta = {};
  delta.removed_components = map.LiveComponents();
  EXPECT_TRUE(refused(delta)) << "it has keyframes" << map.Apply(delta).status();
  auto keyframe = std::make_shared<Keyframe>(map.keyframe(KeyframeId(2)));
  std::uint32_t seen = 0;
  while (!keyframe->points[seen]) ++seen;
  keyframe->points[seen] = PointId();
  delta = {};
  delta.keyframes = {keyframe};
  EXPECT_TRUE(refused(delta)) << "the point still lists the observation";
  keyframe = std::make_shared<Keyframe>(map.keyframe(KeyframeId(2)));
  keyframe->covisible.pop_back();
  delta.keyframes = {keyframe};
  EXPECT_TRUE(refused(delta)) << "the neighbour still lists it";
}

TEST(Snapshot, RefusesValuesOutOfRange) {
  const TestMap world = MakeMap(5, 3, 60);
  const Snapshot& map = *world.snapshot;
  const auto status = [&](std::shared_ptr<Keyframe> keyframe, bool moved) {
    Delta delta;
    delta.base = map.revision();
    delta.next_keyframe = map.next_keyframe();
    delta.next_point = map.next_point();
    delta.keyframes = {keyframe};
    if (moved) delta.moved_keypoints = {keyframe->id};
    return map.Apply(delta).status();
  };
  const auto changed = [&](auto change) {
    auto keyframe = std::make_shared<Keyframe>(map.keyframe(KeyframeId(2)));
    auto features = std::make_shared<KeyframeFeatures>(*keyframe->features);
    change(*features);
    keyframe->features = std::move(features);
    return keyframe;
  };
  EXPECT_TRUE(status(changed([](KeyframeFeatures& f) { f.features.keypoints[0].x_px += 1.0f; }), true).ok());
  EXPECT_FALSE(status(changed([](KeyframeFeatures& f) { f.features.keypoints[0].x_px += 1.0f; }), false).ok());
  EXPECT_FALSE(status(changed([](KeyframeFeatures& f) { f.features.keypoints[0].octave = 8; }), true).ok());
  EXPECT_FALSE(status(changed([](KeyframeFeatures& f) { f.features.keypoints[0].y_px = std::nanf(""); }), true).ok());
  EXPECT_FALSE(status(changed([](KeyframeFeatures& f) { f.features.descriptors[0][0] ^= 1; }), true).ok());
  auto keyframe = std::make_shared<Keyframe>(map.keyframe(KeyframeId(2)));
  keyframe->camera_from_map = SE3(Quaterniond::Identity(), Vector3d(0, std::nan(""), 0));
  EXPECT_FALSE(status(keyframe, false).ok());
}

// Random edits: merged, they lead to the same map as one after the other.
TEST(MergeDeltas, IsTheSameAsOneAfterTheOther) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const TestMap world = MakeMap(seed, 6, 150);
    Random random(seed);
    std::shared_ptr<const Snapshot> map = world.snapshot;
    std::optional<Delta> merged;
    for (int step = 0; step < 6; ++step) {
      Edit edit(map);
      std::vector<PointId> points;
      map->points().ForEach([&](const auto& point) { points.push_back(point->id); });
      for (int i = 0; i < 5; ++i) {
        const PointId point = points[random.Below(static_cast<std::uint32_t>(points.size()))];
        if (edit.FindPoint(point) == nullptr) continue;
        if (random.Below(2) == 0) {
          edit.ErasePoint(point);
        } else {
          edit.SetPosition(point, edit.point(point).position + Vector3d(0.01, 0, 0));
        }
      }
      if (step == 2) edit.EraseKeyframe(KeyframeId(4));
      if (step < 4) {
        std::vector<std::size_t> visible;
        const KeyframeId added = edit.AddKeyframe(testing::MakeKeyframe(world, 1, 0.0, random, &visible));
        const PointId point = edit.AddPoint(Vector3d(0, 0, 4));
        edit.AddObservation(point, added, 0);
      }
      const Delta delta = edit.Finish("step");
      auto next = map->Apply(delta);
      ASSERT_TRUE(next.ok()) << next.status();
      if (merged) {
        auto both = MergeDeltas(*world.snapshot, *merged, delta);
        ASSERT_TRUE(both.ok()) << both.status();
        merged = *both;
      } else {
        merged = delta;
      }
      map = *next;
    }
    const auto at_once = world.snapshot->Apply(*merged);
    ASSERT_TRUE(at_once.ok()) << at_once.status();
    EXPECT_EQ((*at_once)->revision(), map->revision());
    EXPECT_EQ((*at_once)->keyframes().size(), map->keyframes().size());
    EXPECT_EQ((*at_once)->points().size(), map->points().size());
    map->keyframes().ForEach(
        [&](const auto& keyframe) { EXPECT_EQ((*at_once)->keyframes().FindPointer(keyframe->id), keyframe); });
    map->points().ForEach([&](const auto& point) { EXPECT_EQ((*at_once)->points().FindPointer(point->id), point); });
  }
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

#include "map/edit.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "map/lens.h"
#include "map/testing_map.h"

namespace cairn::map {
namespace {

using testing::MakeMap;
using testing::TestMap;

std::shared_ptr<const Snapshot> Commit(const Snapshot& base, Edit& edit) {
  const auto next = base.Apply(edit.Finish("test"));
  EXPECT_TRUE(next.ok()) << next.status();
  if (!next.ok()) return nullptr;
  EXPECT_TRUE((*next)->CheckConsistency().ok()) << (*next)->CheckConsistency();
  return *next;
}

PointId FirstPointOf(const Snapshot& map, KeyframeId keyframe) {
  for (const PointId point : map.keyframe(keyframe).points) {
    if (point) return point;
  }
  return PointId();
}

TEST(Edit, MakesAConsistentMap) {
  const TestMap world = MakeMap(1, 6, 300);
  ASSERT_NE(world.snapshot, nullptr);
  EXPECT_TRUE(world.snapshot->CheckConsistency().ok()) << world.snapshot->CheckConsistency();
  EXPECT_EQ(world.snapshot->keyframes().size(), 6u);
  EXPECT_EQ(world.snapshot->revision(), 2u);
  const Keyframe& first = world.snapshot->keyframe(KeyframeId(1));
  EXPECT_FALSE(first.parent) << "the root";
  EXPECT_FALSE(first.covisible.empty());
  for (std::size_t i = 1; i < first.covisible.size(); ++i) {
    EXPECT_GE(first.covisible[i - 1].shared_points, first.covisible[i].shared_points);
  }
}

TEST(Edit, DerivesHowAPointIsSeen) {
  const TestMap world = MakeMap(2, 4, 200);
  world.snapshot->points().ForEach([&](const std::shared_ptr<const MapPoint>& point) {
    EXPECT_NEAR(point->mean_view_direction.norm(), 1.0f, 1e-5f);
    const Keyframe& reference = world.snapshot->keyframe(point->reference.keyframe);
    const double distance = (point->position - reference.CenterInMap()).norm();
    EXPECT_NEAR(point->pixel_size, distance * 1.2 / testing::kPinhole.fx_px, 1e-6) << "all features are of octave 1";
    EXPECT_EQ(point->descriptor, reference.descriptors()[point->reference.feature]);
  });
}

TEST(Edit, LeavesTheBaseAlone) {
  const TestMap world = MakeMap(3, 3, 100);
  const PointId point = FirstPointOf(*world.snapshot, KeyframeId(2));
  const Vector3d before = world.snapshot->point(point).position;
  Edit edit(world.snapshot);
  edit.SetPosition(point, Vector3d(9, 9, 9));
  edit.SetPose(KeyframeId(2), SE3());
  edit.ErasePoint(FirstPointOf(*world.snapshot, KeyframeId(3)));
  EXPECT_EQ(edit.FindPoint(FirstPointOf(*world.snapshot, KeyframeId(3))), nullptr);
  EXPECT_EQ(world.snapshot->point(point).position, before);
  EXPECT_EQ(edit.ChangedKeyframes().front(), KeyframeId(1)) << "it lost an observation";
}

TEST(Edit, RefusesSecondObservations) {
  const TestMap world = MakeMap(4, 3, 100);
  Edit edit(world.snapshot);
  const Keyframe& keyframe = world.snapshot->keyframe(KeyframeId(1));
  std::uint32_t taken = 0;
  while (!keyframe.points[taken]) ++taken;
  const PointId other = edit.AddPoint(Vector3d(0, 0, 4));
  EXPECT_FALSE(edit.AddObservation(other, KeyframeId(1), taken)) << "the feature has a point";
  EXPECT_FALSE(edit.AddObservation(keyframe.points[taken], KeyframeId(1), taken + 1)) << "observed already";
  EXPECT_FALSE(edit.AddObservation(other, KeyframeId(1), 1000000)) << "no such feature";
  const Delta delta = edit.Finish("nothing");
  EXPECT_TRUE(delta.empty()) << "a point without observations is dropped";
}

TEST(Edit, RemovingObservationsErasesThePointInTheEnd) {
  const TestMap world = MakeMap(5, 3, 100);
  const PointId point = FirstPointOf(*world.snapshot, KeyframeId(1));
  const std::vector<Observation> observations = world.snapshot->point(point).observations;
  Edit edit(world.snapshot);
  for (std::size_t i = 0; i < observations.size() && edit.FindPoint(point) != nullptr; ++i) {
    edit.RemoveObservation(point, observations[i].keyframe);
  }
  EXPECT_EQ(edit.FindPoint(point), nullptr);
  const auto next = Commit(*world.snapshot, edit);
  ASSERT_NE(next, nullptr);
  EXPECT_EQ(next->points().size(), world.snapshot->points().size() - 1);
}

TEST(Edit, ErasingAKeyframeKeepsTheTree) {
  const TestMap world = MakeMap(6, 8, 400);
  Edit edit(world.snapshot);
  EXPECT_FALSE(edit.EraseKeyframe(KeyframeId(1))) << "the root stays";
  EXPECT_TRUE(edit.EraseKeyframe(KeyframeId(3)));
  EXPECT_TRUE(edit.EraseKeyframe(KeyframeId(4)));
  const auto next = Commit(*world.snapshot, edit);
  ASSERT_NE(next, nullptr);
  EXPECT_EQ(next->keyframes().size(), 6u);
  int roots = 0;
  next->keyframes().ForEach(
      [&](const std::shared_ptr<const Keyframe>& keyframe) { roots += keyframe->parent ? 0 : 1; });
  EXPECT_EQ(roots, 1);
}

TEST(Edit, AKeyframeAddedHereMayGoAgain) {
  const TestMap world = MakeMap(7, 3, 100);
  Random random(1);
  std::vector<std::size_t> visible;
  Edit edit(world.snapshot);
  const KeyframeId id = edit.AddKeyframe(testing::MakeKeyframe(world, 1, 0.0, random, &visible));
  edit.AddObservation(FirstPointOf(*world.snapshot, KeyframeId(2)), id, 0);
  EXPECT_TRUE(edit.EraseKeyframe(id));
  const auto next = Commit(*world.snapshot, edit);
  ASSERT_NE(next, nullptr);
  EXPECT_EQ(next->keyframes().size(), 3u);
  EXPECT_EQ(next->next_keyframe(), KeyframeId(id.value() + 1)) << "ids are never used twice";
}

TEST(Edit, FusingPointsJoinsTheirObservations) {
  const TestMap world = MakeMap(8, 4, 200);
  Edit edit(world.snapshot);
  // A double of a point: take two of its observations over to a new one.
  PointId point;
  world.snapshot->points().ForEach([&](const std::shared_ptr<const MapPoint>& p) {
    if (!point && p->observations.size() == 4) point = p->id;
  });
  ASSERT_TRUE(point);
  const std::vector<Observation> observations = world.snapshot->point(point).observations;
  const PointId twin = edit.AddPoint(world.snapshot->point(point).position);
  for (int i = 0; i < 2; ++i) {
    edit.RemoveObservation(point, observations[i].keyframe, 1);
    EXPECT_TRUE(edit.AddObservation(twin, observations[i].keyframe, observations[i].feature));
  }
  edit.FusePoints(twin, point);
  EXPECT_EQ(edit.FindPoint(twin), nullptr);
  EXPECT_EQ(edit.point(point).observations, observations);
  EXPECT_EQ(edit.point(point).times_visible, world.snapshot->point(point).times_visible + 1);
  edit.FusePoints(point, point);
  EXPECT_NE(edit.FindPoint(point), nullptr) << "with itself: nothing happens";
  EXPECT_NE(Commit(*world.snapshot, edit), nullptr);
}

TEST(Edit, LinksALonelyKeyframeOnlyIfItIsAlone) {
  const TestMap world = MakeMap(9, 4, 200);
  Random random(1);
  std::vector<std::size_t> visible;
  Edit edit(world.snapshot);
  const KeyframeId lonely = edit.AddKeyframe(testing::MakeKeyframe(world, 0, 0.0, random, &visible));
  const KeyframeId linked = edit.AddKeyframe(testing::MakeKeyframe(world, 1, 0.0, random, &visible));
  const Keyframe& twin = world.snapshot->keyframe(KeyframeId(2));  // sees the same, feature by feature
  for (std::uint32_t i = 0; i < visible.size(); ++i) {
    if (twin.points[i]) edit.AddObservation(twin.points[i], linked, i);
  }
  edit.LinkIfAlone(lonely, KeyframeId(3));
  edit.LinkIfAlone(linked, KeyframeId(1));
  const auto next = Commit(*world.snapshot, edit);
  ASSERT_NE(next, nullptr);
  EXPECT_EQ(next->keyframe(lonely).parent, KeyframeId(3));
  EXPECT_EQ(next->keyframe(linked).parent, KeyframeId(2)) << "the one it shares most with";
}

TEST(Edit, MovesKeypointsAndReplacesACamera) {
  const TestMap world = MakeMap(3, 4, 100);
  Edit edit(world.snapshot);
  MapCamera camera = edit.camera(world.camera);
  camera.lens = LensCorrection{1.01, 0.02, 0.0};
  edit.PutCamera(camera);
  EXPECT_EQ(edit.camera(world.camera).lens, camera.lens);
  std::vector<image::Keypoint> keypoints = edit.keyframe(KeyframeId(2)).keypoints();
  CorrectKeypoints(camera, keypoints);
  edit.SetKeypoints(KeyframeId(2), keypoints);
  MapCamera another = camera;
  EXPECT_EQ(edit.AddCamera(another).value(), world.camera.value() + 1);

  const auto after = world.snapshot->Apply(edit.Finish("lens"));
  ASSERT_TRUE(after.ok()) << after.status();
  EXPECT_EQ((*after)->cameras().at(world.camera).lens, camera.lens);
  EXPECT_EQ((*after)->keyframe(KeyframeId(2)).keypoints(), keypoints);
  EXPECT_EQ((*after)->keyframe(KeyframeId(2)).descriptors(), world.snapshot->keyframe(KeyframeId(2)).descriptors());
  EXPECT_NE(world.snapshot->keyframe(KeyframeId(2)).keypoints(), keypoints) << "the base is left alone";
  // Where the pinhole would have seen them: the centre stays, the corners move most, and on the grid of 1/32 px.
  for (std::size_t i = 0; i < keypoints.size(); ++i) {
    const image::Keypoint& was = world.snapshot->keyframe(KeyframeId(2)).keypoints()[i];
    const double moved = std::hypot(keypoints[i].x_px - was.x_px, keypoints[i].y_px - was.y_px);
    const double radius = std::hypot(was.x_px - 320.0, was.y_px - 240.0);
    EXPECT_NEAR(moved, radius * (1.0 - 1.0 / (1.01 * (1.0 + 0.02 * std::pow(radius / 505.0, 2)))), 0.2);
    EXPECT_EQ(keypoints[i].x_px * 32.0f, std::round(keypoints[i].x_px * 32.0f));
  }
}

TEST(Edit, RandomChangesKeepTheMapConsistent) {
  TestMap world = MakeMap(10, 10, 300);
  Random random(5);
  std::shared_ptr<const Snapshot> map = world.snapshot;
  for (int round = 0; round < 20; ++round) {
    Edit edit(map);
    for (int step = 0; step < 20; ++step) {
      const auto keyframe = KeyframeId(static_cast<KeyframeId::Value>(1 + random.Below(10)));
      const auto point = PointId(static_cast<PointId::Value>(1 + random.Below(map->next_point().value() - 1)));
      const auto other = PointId(static_cast<PointId::Value>(1 + random.Below(map->next_point().value() - 1)));
      const bool has_keyframe = edit.FindKeyframe(keyframe) != nullptr, has_point = edit.FindPoint(point) != nullptr;
      switch (random.Below(6)) {
        case 0:
          if (has_keyframe && has_point) edit.RemoveObservation(point, keyframe);
          break;
        case 1:
          if (has_point && edit.FindPoint(other) != nullptr) edit.FusePoints(point, other);
          break;
        case 2:
          if (has_keyframe && random.Uniform() < 0.05) edit.EraseKeyframe(keyframe);
          break;
        case 3:
          if (has_keyframe) edit.SetPose(keyframe, SE3(Quaterniond::Identity(), Vector3d(random.Normal(), 0, 0)));
          break;
        case 4:
          if (has_point) edit.SetPosition(point, Vector3d(random.Normal(), random.Normal(), 4));
          break;
        default:
          if (has_keyframe && !edit.keyframe(keyframe).points.empty()) {
            edit.AddObservation(edit.AddPoint(Vector3d(0, 0, 4)), keyframe,
                                static_cast<std::uint32_t>(random.Below(edit.keyframe(keyframe).points.size())));
          }
      }
    }
    map = Commit(*map, edit);
    ASSERT_NE(map, nullptr);
  }
}

// A second component: the same row of cameras once more, moved by a similarity, with points of its own.
struct TwoComponents {
  std::shared_ptr<const Snapshot> map;
  ComponentId first, second;
  Sim3 first_from_second;
};

TwoComponents MakeTwo(std::uint64_t seed) {
  TestMap world = MakeMap(seed, 4, 150);
  TwoComponents two;
  two.first = world.snapshot->LiveComponents().front();
  two.first_from_second = Sim3(ExpSO3(Vector3d(0.2, -0.4, 0.1)), Vector3d(1.0, 2.0, -0.5), 1.7);
  const Sim3 second_from_first = two.first_from_second.Inverse();
  Edit edit(world.snapshot);
  two.second = edit.AddComponent({.id = {}, .session = world.session});
  Random random(seed + 9);
  std::vector<std::vector<Observation>> seen(world.truth.size());
  for (std::size_t view = 0; view < 3; ++view) {
    std::vector<std::size_t> visible;
    Keyframe keyframe = testing::MakeKeyframe(world, view, 0.0, random, &visible);
    keyframe.component = two.second;
    keyframe.direct_segment = 5;
    keyframe.camera_from_map = RigidPart(Sim3(keyframe.camera_from_map) * two.first_from_second);
    const KeyframeId id = edit.AddKeyframe(keyframe);
    for (std::uint32_t i = 0; i < visible.size(); ++i) seen[visible[i]].push_back({id, i});
  }
  for (std::size_t i = 0; i < seen.size(); ++i) {
    if (seen[i].size() < 2) continue;
    const PointId point = edit.AddPoint(second_from_first * world.truth[i]);
    for (const Observation& o : seen[i]) edit.AddObservation(point, o.keyframe, o.feature);
  }
  two.map = Commit(*world.snapshot, edit);
  return two;
}

TEST(Edit, JoinsOneComponentToAnother) {
  const TwoComponents two = MakeTwo(21);
  ASSERT_NE(two.map, nullptr);
  EXPECT_EQ(two.map->LiveComponents(), (std::vector<ComponentId>{two.first, two.second}));
  EXPECT_EQ(two.map->NumKeyframes(two.second), 3);
  Edit edit(two.map);
  Component aligned = two.map->component(two.second);
  aligned.world_from_component = Sim3(Quaterniond::Identity(), Vector3d(5, 0, 0), 3.0);
  edit.PutComponent(aligned);
  ComponentJoin join;
  join.into = two.first;
  join.into_from_component = two.first_from_second;
  join.keyframe = KeyframeId(6), join.into_keyframe = KeyframeId(2);
  edit.JoinComponent(two.second, join);
  const auto joined = Commit(*two.map, edit);
  ASSERT_NE(joined, nullptr);
  EXPECT_EQ(joined->LiveComponents(), std::vector<ComponentId>{two.first});
  EXPECT_EQ(joined->NumKeyframes(two.first), 7);
  EXPECT_EQ(joined->Resolve(two.second), two.first);
  EXPECT_EQ(joined->keyframe(KeyframeId(6)).parent, KeyframeId(2)) << "the trees are one";
  EXPECT_EQ(joined->keyframe(KeyframeId(5)).parent, KeyframeId(6)) << "turned about";
  for (KeyframeId::Value i = 0; i < 3; ++i) {
    const SE3 moved = joined->keyframe(KeyframeId(5 + i)).camera_from_map;
    const SE3 twin = joined->keyframe(KeyframeId(1 + i)).camera_from_map;
    EXPECT_LT((moved.Matrix() - twin.Matrix()).norm(), 1e-9);
  }
  ASSERT_TRUE(joined->WorldFrom(two.first).has_value()) << "the only alignment there is";
  EXPECT_NEAR(joined->WorldFrom(two.first)->scale(), 3.0 / 1.7, 1e-12);
}

TEST(Edit, AComponentIsErasedWithItsPointsUnlessItIsHistory) {
  const TwoComponents two = MakeTwo(21);
  ASSERT_NE(two.map, nullptr);
  Edit edit(two.map);
  edit.EraseComponent(two.second);
  const auto without = Commit(*two.map, edit);
  ASSERT_NE(without, nullptr);
  EXPECT_EQ(without->NumKeyframes(two.second), 0);
  EXPECT_FALSE(without->components().contains(two.second));
  EXPECT_EQ(without->NumKeyframes(two.first), two.map->NumKeyframes(two.first));
  two.map->points().ForEach([&](const auto& point) {
    const bool second = two.map->keyframe(point->reference.keyframe).component == two.second;
    EXPECT_EQ(without->points().Contains(point->id), !second);
  });
  // One that another was joined to stays as a row.
  Edit joining(two.map);
  ComponentJoin join;
  join.into = two.first;
  join.into_from_component = two.first_from_second;
  join.keyframe = KeyframeId(6), join.into_keyframe = KeyframeId(2);
  joining.JoinComponent(two.second, join);
  const auto joined = Commit(*two.map, joining);
  ASSERT_NE(joined, nullptr);
  Edit all(joined);
  all.EraseComponent(two.first);
  const auto empty = Commit(*joined, all);
  ASSERT_NE(empty, nullptr);
  EXPECT_TRUE(empty->keyframes().empty());
  EXPECT_TRUE(empty->components().contains(two.first));
}

TEST(Edit, AnotherKeyframeBecomesTheRootAndTheOldOneMayGo) {
  const TestMap world = MakeMap(6, 8, 400);
  Edit edit(world.snapshot);
  edit.MakeRoot(KeyframeId(5));
  EXPECT_FALSE(edit.EraseKeyframe(KeyframeId(5)));
  EXPECT_TRUE(edit.EraseKeyframe(KeyframeId(1)));
  const auto next = Commit(*world.snapshot, edit);
  ASSERT_NE(next, nullptr);
  EXPECT_EQ(next->keyframes().size(), 7u);
  next->keyframes().ForEach(
      [&](const auto& keyframe) { EXPECT_EQ(keyframe->parent.valid(), keyframe->id != KeyframeId(5)); });
}

TEST(Edit, LinksOfAKeyframeStayWithinItsComponent) {
  const TwoComponents two = MakeTwo(22);
  ASSERT_NE(two.map, nullptr);
  Edit edit(two.map);
  const PointId other = FirstPointOf(*two.map, KeyframeId(5));
  edit.ErasePoint(FirstPointOf(*two.map, KeyframeId(1)));
  std::uint32_t free = 0;
  while (edit.keyframe(KeyframeId(1)).points[free]) ++free;
  ASSERT_TRUE(edit.AddObservation(other, KeyframeId(1), free));
  const auto refused = two.map->Apply(edit.Finish("a point of two components"));
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kInvalidArgument) << refused.status();
}

TEST(Edit, IdsAreNotUsedTwiceAfterRemovals) {
  const TestMap world = MakeMap(23, 3, 60);
  Edit add(world.snapshot);
  const CameraId camera =
      add.AddCamera({CameraId(), "other", Camera::FromPinhole(testing::kPinhole), testing::kPinhole});
  const ComponentId component = add.AddComponent({.id = {}, .session = world.session});
  const auto more = Commit(*world.snapshot, add);
  ASSERT_NE(more, nullptr);
  Delta remove;
  remove.base = more->revision();
  remove.removed_cameras = {camera};
  remove.removed_components = {component};
  const auto fewer = more->Apply(remove);
  ASSERT_TRUE(fewer.ok()) << fewer.status();
  Edit again(*fewer);
  EXPECT_EQ(again.AddCamera({CameraId(), "third", Camera::FromPinhole(testing::kPinhole), testing::kPinhole}),
            CameraId(camera.value() + 1));
  EXPECT_EQ(again.AddComponent({}), ComponentId(component.value() + 1));
}

}  // namespace
}  // namespace cairn::map

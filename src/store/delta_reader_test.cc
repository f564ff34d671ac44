#include "store/delta_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "map/lens.h"
#include "store/digest.h"
#include "store/sqlite_map_store.h"
#include "store/testing_maps.h"

namespace cairn::store {
namespace {

using testing::MapGrower;
using testing::SameBits;
using testing::SnapshotPtr;
using testing::TempFolder;
using testing::TestInfo;

// Changes of every kind, in a random order.
class Mutator {
 public:
  explicit Mutator(std::uint64_t seed) : random_(seed), grower_(seed, {.features = 40, .new_points = 12}) {}

  map::Delta Start(const SnapshotPtr& map) { return grower_.Start(map); }

  map::Delta Next(const SnapshotPtr& map) {
    if (map->keyframes().size() < 6) return grower_.AddKeyframe(map);
    switch (random_.Below(12)) {
      case 0:
        return grower_.Adjust(map, 3);
      case 1:
        return grower_.Cull(map);
      case 2:
        return grower_.Align(map);
      case 3:
        return BeginComponent(map);
      case 4:
        return map->LiveComponents().size() > 1 ? Join(map) : grower_.Adjust(map, 2);
      case 5:
        return CorrectLens(map);
      case 6:
        return CloseLoop(map);
      case 7:
        return AddCameraAndSession(map);
      case 8:
        return RemoveUnused(map);
      default:
        return grower_.AddKeyframe(map);
    }
  }

 private:
  map::Delta BeginComponent(const SnapshotPtr& map) {
    map::Edit edit(map);
    edit.SetSession(SessionId(1));
    const ComponentId component = edit.AddComponent({ComponentId(), SessionId(1)});
    std::vector<KeyframeId> keyframes;
    for (int i = 0; i < 3; ++i) {
      map::Keyframe keyframe;
      keyframe.session = SessionId(1);
      keyframe.camera = CameraId(1);
      keyframe.component = component;
      keyframe.time_ns = 5000 + i;
      keyframe.camera_from_map = SE3(ExpSO3(Vector3d(0, 0.1 * i, 0)), Vector3d(0.1 * i, 0, 0));
      keyframe.features = grower_.RandomFeatures();
      keyframes.push_back(edit.AddKeyframe(keyframe));
    }
    for (std::uint32_t feature = 0; feature < 20; ++feature) {
      const PointId point = edit.AddPoint(Vector3d(random_.Normal(), random_.Normal(), 4));
      for (const KeyframeId keyframe : keyframes) edit.AddObservation(point, keyframe, feature);
    }
    return edit.Finish("component " + std::to_string(component.value()));
  }

  map::Delta Join(const SnapshotPtr& map) {
    const std::vector<ComponentId> live = map->LiveComponents();
    map::ComponentJoin join;
    join.into = live.front();
    join.into_from_component = Sim3(ExpSO3(Vector3d(0.1, 0.2, 0)), Vector3d(3, 0, -1), random_.Uniform(0.5, 2));
    map->keyframes().ForEach([&](const auto& keyframe) {
      if (keyframe->component == live.back()) join.keyframe = keyframe->id;
      if (keyframe->component == live.front()) join.into_keyframe = keyframe->id;
    });
    join.matches = 40;
    join.keyframes_agreeing = 3;
    join.keyframes_checked = 4;
    join.revision = map->revision() + 1;
    map::Edit edit(map);
    edit.JoinComponent(live.back(), join);
    return edit.Finish("join");
  }

  map::Delta CorrectLens(const SnapshotPtr& map) {
    map::Edit edit(map);
    map::MapCamera camera = map->cameras().begin()->second;
    camera.lens = LensCorrection{1.0 + random_.Normal(0, 1e-3), random_.Normal(0, 1e-2), 0.0};
    edit.PutCamera(camera);
    map->keyframes().ForEach([&](const auto& keyframe) {
      if (random_.Below(2) == 0) return;
      std::vector<image::Keypoint> keypoints = keyframe->keypoints();
      map::CorrectKeypoints(camera, keypoints);
      edit.SetKeypoints(keyframe->id, keypoints);
    });
    return edit.Finish("lens");
  }

  map::Delta CloseLoop(const SnapshotPtr& map) {
    map::Edit edit(map);
    map::Session session = map->sessions().begin()->second;
    session.loops.push_back({KeyframeId(5), 2, KeyframeId(1), 1, 50, 1.01, 0.25, 0.1, 60.5});
    session.trajectory = map::ReportedTrajectory{true, 4, 0, "refined: a loop was closed"};
    edit.PutSession(session);
    return edit.Finish("close loop");
  }

  map::Delta AddCameraAndSession(const SnapshotPtr& map) {
    map::Edit edit(map);
    map::MapCamera camera = map->cameras().begin()->second;
    camera.name = "another";
    edit.AddCamera(camera);
    map::Session session = map->sessions().begin()->second;
    session.policy = map::SessionPolicy::kExtend;
    session.result = map::SessionResult::kApart;
    session.removed = random_.Below(2) == 0;
    edit.AddSession(session);
    edit.AddComponent({ComponentId(), SessionId(1)});  // stays empty
    return edit.Finish("camera, session, component");
  }

  // A camera that no session has, and a component that is no keyframe's and no history.
  map::Delta RemoveUnused(const SnapshotPtr& map) {
    map::Delta delta;
    delta.base = map->revision();
    delta.reason = "remove what is not used";
    for (const auto& [id, camera] : map->cameras()) {
      if (id != CameraId(1)) delta.removed_cameras.push_back(id);
    }
    for (const auto& [id, component] : map->components()) {
      bool is_target = map->NumKeyframes(id) > 0 || component.joined.has_value();
      for (const auto& [other, joined] : map->components()) {
        is_target = is_target || (joined.joined && joined.joined->into == id);
      }
      for (const auto& [session_id, session] : map->sessions()) {
        const auto& touched = session.components;
        is_target = is_target || std::find(touched.begin(), touched.end(), id) != touched.end();
      }
      if (!is_target) delta.removed_components.push_back(id);
    }
    return delta;
  }

  Random random_;
  MapGrower grower_;
};

TEST(DeltaReader, FromAnyRevisionToTheNewest) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const TempFolder folder;
    const std::string path = folder.File("a.cairn");
    auto file =
        *SqliteMapStore::Create(path, TestInfo(), {.vocabulary = "words", .write = {.sync_every_commit = false}});
    auto reader = *SqliteMapStore::OpenReadOnly(path);
    Mutator mutator(seed);
    std::vector<SnapshotPtr> history = {map::Snapshot::Empty(TestInfo())};
    for (int step = 0; step < 60; ++step) {
      const map::Delta delta = step == 0 ? mutator.Start(history.back()) : mutator.Next(history.back());
      const auto next = history.back()->Apply(delta);
      ASSERT_TRUE(next.ok()) << delta.reason << ": " << next.status();
      ASSERT_TRUE(file->Commit(delta).ok()) << delta.reason;
      history.push_back(*next);
      const SnapshotPtr loaded = *reader->LoadSnapshot();
      ASSERT_TRUE(SameBits(*loaded, *history.back())) << delta.reason;
      // From the one before, from a random one, and at times from all.
      for (std::size_t i = 0; i < history.size(); ++i) {
        if (i + 2 != history.size() && step % 20 != 19 && i % 7 != static_cast<std::size_t>(step) % 7) continue;
        const auto read = reader->ReadDelta(*history[i]);
        ASSERT_TRUE(read.ok()) << read.status();
        ASSERT_TRUE(read->has_value());
        EXPECT_EQ((*read)->num_changes, history.size() - 1 - i);
        const auto applied = history[i]->Apply(**read);
        ASSERT_TRUE(applied.ok()) << "from " << i << ", after " << delta.reason << ": " << applied.status();
        EXPECT_TRUE(SameBits(**applied, *history.back())) << "from " << i << ", after " << delta.reason;
        EXPECT_EQ(ContentDigest(**applied), ContentDigest(*history.back()));
        if (i + 2 != history.size()) continue;
        EXPECT_EQ((*read)->reason, delta.reason);
        EXPECT_EQ((*read)->session, delta.session);
        EXPECT_EQ((*read)->keyframes.size(), delta.keyframes.size());
        EXPECT_EQ((*read)->points.size(), delta.points.size());
        EXPECT_EQ((*read)->moved_keypoints, delta.moved_keypoints);
        for (const auto& keyframe : (*read)->keyframes) {
          const map::Keyframe* before = history[i]->keyframes().Find(keyframe->id);
          const auto& moved = delta.moved_keypoints;
          if (before == nullptr || std::find(moved.begin(), moved.end(), keyframe->id) != moved.end()) continue;
          EXPECT_EQ(keyframe->features, before->features);  // shared, not read again
        }
      }
    }
    EXPECT_THAT(*reader->Verify(), ::testing::IsEmpty());
  }
}

TEST(DeltaReader, TellsWhatItCannotBridge) {
  const TempFolder folder;
  auto file = *SqliteMapStore::Create(folder.File("a.cairn"), TestInfo(), {.write = {.sync_every_commit = false}});
  SnapshotPtr map = map::Snapshot::Empty(TestInfo());
  const SnapshotPtr start = map;
  EXPECT_EQ((*file->ReadDelta(*map))->num_changes, 0u);
  SnapshotPtr oldest;
  for (Revision i = 0; i < kMaxDeltaRevisions + 5; ++i) {
    map::Delta delta;
    delta.base = map->revision();
    delta.reason = "nothing";
    map = *map->Apply(delta);
    ASSERT_TRUE(file->Commit(delta).ok());
    if (map->revision() == 5) oldest = map;
  }
  EXPECT_FALSE(file->ReadDelta(*start)->has_value());
  const auto delta = *file->ReadDelta(*oldest);
  ASSERT_TRUE(delta.has_value());
  EXPECT_EQ(delta->num_changes, kMaxDeltaRevisions);
  EXPECT_EQ((*oldest->Apply(*delta))->revision(), map->revision());
  map::MapInfo other = TestInfo();
  other.id[0] = 'f';
  EXPECT_FALSE(file->ReadDelta(*map::Snapshot::Empty(other, map->revision()))->has_value());
  EXPECT_FALSE(file->ReadDelta(*map::Snapshot::Empty(TestInfo(), map->revision() + 1))->has_value());
}

TEST(DeltaReader, ReadsWhatChanged) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  auto file = *SqliteMapStore::Create(path, TestInfo(), {.write = {.sync_every_commit = false}});
  MapGrower grower(8, {.features = 1000, .new_points = 150});
  SnapshotPtr map = map::Snapshot::Empty(TestInfo());
  const auto change = [&](const map::Delta& delta) {
    map = *map->Apply(delta);
    ASSERT_TRUE(file->Commit(delta).ok());
  };
  // Pages that a new connection reads for one more keyframe.
  const auto pages_for_one = [&](int keyframes) {
    while (static_cast<int>(map->keyframes().size()) < keyframes) change(grower.AddKeyframe(map));
    const SnapshotPtr before = map;
    change(grower.AddKeyframe(map));
    auto database = *Database::OpenFile(path, Database::Mode::kQueryOnly);
    const Transaction transaction = *Transaction::Begin(database.get(), Transaction::Kind::kRead);
    const auto delta = *DeltaReader(database.get(), *before).Read();
    EXPECT_EQ(delta->num_changes, 1u);
    return database->PagesRead();
  };
  change(grower.Start(map));
  const std::int64_t at_20 = pages_for_one(20);
  const std::int64_t at_80 = pages_for_one(80);
  EXPECT_LE(at_80, at_20 * 3 / 2);
  EXPECT_LE(at_80, *(*Database::OpenFile(path, Database::Mode::kQueryOnly))->QueryInt("PRAGMA page_count") / 10);
}

}  // namespace
}  // namespace cairn::store

#include "store/delta_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "store/digest.h"
#include "store/sqlite_map_store.h"
#include "store/testing_maps.h"
#include "store/testing_mutator.h"

namespace cairn::store {
namespace {

using testing::MapGrower;
using testing::MapMutator;
using testing::SameBits;
using testing::SnapshotPtr;
using testing::TempFolder;
using testing::TestInfo;

// A follower is told of every row that differs, and of what else was touched.
void ExpectCovers(const map::ChangedRows& told, const map::ChangedRows& different) {
  EXPECT_EQ(told.base, different.base);
  EXPECT_GE(told.info, different.info);
  EXPECT_TRUE(std::ranges::includes(told.cameras, different.cameras));
  EXPECT_TRUE(std::ranges::includes(told.sessions, different.sessions));
  EXPECT_TRUE(std::ranges::includes(told.components, different.components));
  EXPECT_TRUE(std::ranges::includes(told.points, different.points));
  for (const map::ChangedKeyframe& keyframe : different.keyframes) {
    const auto found = std::ranges::find(told.keyframes, keyframe.id, &map::ChangedKeyframe::id);
    ASSERT_NE(found, told.keyframes.end()) << keyframe.id;
    EXPECT_GE(found->features, keyframe.features) << keyframe.id;
    EXPECT_GE(found->points, keyframe.points) << keyframe.id;
  }
}

// All of the map has ids below, and none that it would give next is.
void ExpectSeparates(const std::optional<map::FirstNewIds>& first_new, const map::Snapshot& map) {
  ASSERT_TRUE(first_new);
  EXPECT_LE(first_new->keyframe, map.next_keyframe());
  EXPECT_LE(first_new->point, map.next_point());
  EXPECT_LE(first_new->camera, map.next_camera());
  EXPECT_LE(first_new->session, map.next_session());
  EXPECT_LE(first_new->component, map.next_component());
  map.keyframes().ForEach([&](const auto& keyframe) { EXPECT_LT(keyframe->id, first_new->keyframe); });
  map.points().ForEach([&](const auto& point) { EXPECT_LT(point->id, first_new->point); });
  for (const auto& [id, camera] : map.cameras()) EXPECT_LT(id, first_new->camera);
  for (const auto& [id, session] : map.sessions()) EXPECT_LT(id, first_new->session);
  for (const auto& [id, component] : map.components()) EXPECT_LT(id, first_new->component);
}

TEST(DeltaReader, FromAnyRevisionToTheNewest) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const TempFolder folder;
    const std::string path = folder.File("a.cairn");
    auto file =
        *SqliteMapStore::Create(path, TestInfo(), {.vocabulary = "words", .write = {.sync_every_commit = false}});
    auto reader = *SqliteMapStore::OpenReadOnly(path);
    MapMutator mutator(seed);
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
        const map::ChangedRows different = map::RowsBetween(*history[i], *history.back());
        EXPECT_EQ(map::RowsBetween(*history[i], *loaded), different) << "by value";
        const auto told = reader->ReadChangedRows(history[i]->revision());
        ASSERT_TRUE(told.ok() && told->has_value()) << told.status();
        ExpectCovers(**told, different);
        ExpectSeparates((*told)->first_new, *history[i]);
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
  EXPECT_FALSE(file->ReadChangedRows(start->revision())->has_value());
  EXPECT_FALSE(file->ReadChangedRows(map->revision() + 1)->has_value());
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

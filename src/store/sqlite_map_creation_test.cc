#include "store/sqlite_map_creation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>

#include "store/digest.h"
#include "store/testing_files.h"
#include "store/testing_maps.h"

namespace cairn::store {
namespace {

using ::testing::ElementsAre;
using testing::ExitCode;
using ::testing::HasSubstr;
using testing::InChild;
using ::testing::IsEmpty;
using testing::LoadMap;
using testing::MakeMap;
using testing::MapGrower;
using testing::SameBits;
using testing::SnapshotPtr;
using testing::TempFolder;
using testing::TestInfo;
using ::testing::UnorderedElementsAre;
using testing::WriteBytes;

// Commits the start of a map and `keyframes`, one by one; null if one of them cannot be.
SnapshotPtr GrowIn(MapStore* store, std::uint64_t seed, int keyframes) {
  MapGrower grower(seed);
  SnapshotPtr map = map::Snapshot::Empty(TestInfo());
  for (int i = 0; i <= keyframes; ++i) {
    const map::Delta delta = i == 0 ? grower.Start(map) : grower.AddKeyframe(map);
    if (!store->Commit(delta).ok()) return nullptr;
    map = *map->Apply(delta);
  }
  return map;
}

TEST(SqliteMapCreation, AMapComesIntoBeingWithItsFirstKeyframe) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  auto store = *CreateMapStore(path, TestInfo(), {.vocabulary = "words"});
  MapGrower grower(1);
  SnapshotPtr map = map::Snapshot::Empty(TestInfo());
  const map::Delta start = grower.Start(map);
  map = *map->Apply(start);
  ASSERT_TRUE(store->Commit(start).ok());
  EXPECT_EQ(store->Commit(start).code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_FALSE(store->exists());
  EXPECT_FALSE(std::filesystem::exists(path));
  EXPECT_EQ(*store->ReadRevision(), 1u);
  EXPECT_TRUE(SameBits(**store->LoadSnapshot(), *map));
  EXPECT_EQ(*store->ContentDigest(), ContentDigest(*map));
  EXPECT_EQ(*store->LoadVocabulary(), "words");
  EXPECT_FALSE(store->ReadSummary().ok());
  // Nobody else makes one there meanwhile.
  EXPECT_EQ(FaultOf(CreateMapStore(path, TestInfo()).status()), Fault::kBusy);

  const map::Delta first = grower.AddKeyframe(map);
  ASSERT_TRUE(store->Commit(first).ok());
  map = *map->Apply(first);
  EXPECT_TRUE(store->exists());
  EXPECT_TRUE(SameBits(*LoadMap(path), *map));
  EXPECT_EQ(store->ReadChanges()->size(), 2u);
  ASSERT_TRUE(store->Close().ok());
  EXPECT_THAT(folder.Names(), ElementsAre("a.cairn"));
  EXPECT_TRUE(SameBits(*LoadMap(path), *map));
  EXPECT_EQ(FaultOf(CreateMapStore(path, TestInfo()).status()), Fault::kExists);
}

TEST(SqliteMapCreation, NoKeyframeLeavesNothing) {
  const TempFolder folder;
  MapGrower grower(2);
  {
    auto store = *CreateMapStore(folder.File("a.cairn"), TestInfo());
    ASSERT_TRUE(store->Commit(grower.Start(map::Snapshot::Empty(TestInfo()))).ok());
    ASSERT_TRUE(store->Close().ok());
  }
  EXPECT_THAT(folder.Names(), IsEmpty());
  const SnapshotPtr old = MakeMap(folder.File("a.cairn"), 3, 3);
  { auto store = *CreateMapStore(folder.File("a.cairn"), TestInfo(), {.overwrite = true}); }
  EXPECT_THAT(folder.Names(), ElementsAre("a.cairn"));
  EXPECT_TRUE(SameBits(*LoadMap(folder.File("a.cairn")), *old));
}

TEST(SqliteMapCreation, TheOldMapStaysUntilTheNewOneIsComplete) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  const SnapshotPtr old = MakeMap(path, 4, 3);
  auto store = *CreateMapStore(path, TestInfo(), {.overwrite = true});
  const SnapshotPtr map = GrowIn(store.get(), 5, 3);
  ASSERT_NE(map, nullptr);
  EXPECT_TRUE(SameBits(*LoadMap(path), *old));
  EXPECT_TRUE(SameBits(*LoadMap(path + "-new"), *map));
  EXPECT_EQ(FaultOf(OpenMapStore(path, OpenMode::kWrite).status()), Fault::kBusy);
  ASSERT_TRUE(store->Close().ok());
  EXPECT_THAT(folder.Names(), ElementsAre("a.cairn"));
  EXPECT_TRUE(SameBits(*LoadMap(path), *map));
}

TEST(SqliteMapCreation, WhatIsToBeWholeIsThereOnceItIsClosed) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  const SnapshotPtr old = MakeMap(folder.File("old.cairn"), 4, 3);
  for (const bool replaces : {false, true}) {
    for (const bool closes : {false, true}) {
      if (replaces) std::filesystem::copy_file(folder.File("old.cairn"), path);
      auto store = *CreateMapStore(path, TestInfo(), {.overwrite = replaces, .whole = true});
      const SnapshotPtr map = GrowIn(store.get(), 5, 2);
      ASSERT_NE(map, nullptr);
      EXPECT_EQ(std::filesystem::exists(path), replaces);
      if (closes) {
        ASSERT_TRUE(store->Close().ok());
      }
      store.reset();
      ASSERT_EQ(std::filesystem::exists(path), replaces || closes);
      if (replaces || closes) {
        EXPECT_TRUE(SameBits(*LoadMap(path), closes ? *map : *old));
      }
      std::filesystem::remove(path);
      EXPECT_THAT(folder.Names(), ElementsAre("old.cairn"));
    }
  }
}

TEST(SqliteMapCreation, AKilledOverwriteLosesNeither) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  const SnapshotPtr old = MakeMap(path, 6, 3);
  const pid_t child = InChild([&] {
    auto store = *CreateMapStore(path, TestInfo(), {.overwrite = true});
    if (GrowIn(store.get(), 7, 3) == nullptr) return 1;
    kill(getpid(), SIGKILL);
    return 0;
  });
  ASSERT_EQ(ExitCode(child), -1);
  for (const OpenMode mode : {OpenMode::kRead, OpenMode::kWrite}) {
    auto store = OpenMapStore(path, mode);
    ASSERT_TRUE(store.ok()) << store.status();
    ASSERT_EQ((*store)->notes().size(), 1u);
    EXPECT_THAT((*store)->notes()[0], HasSubstr("a.cairn-new"));
    EXPECT_TRUE(SameBits(**(*store)->LoadSnapshot(), *old));
  }
  EXPECT_EQ(LoadMap(path + "-new")->keyframes().size(), 3u);
  // The next one that overwrites says so, and takes its place.
  auto store = *CreateMapStore(path, TestInfo(), {.overwrite = true});
  ASSERT_EQ(store->notes().size(), 1u);
  EXPECT_THAT(store->notes()[0], HasSubstr("will be removed"));
  const SnapshotPtr map = GrowIn(store.get(), 8, 1);
  ASSERT_NE(map, nullptr);
  ASSERT_TRUE(store->Close().ok());
  EXPECT_TRUE(SameBits(*LoadMap(path), *map));
  EXPECT_THAT(folder.Names(), ElementsAre("a.cairn"));
}

TEST(SqliteMapCreation, OnlyMapsAreOverwritten) {
  const TempFolder folder;
  WriteBytes(folder.File("notes.txt"), "not a map");
  const absl::Status status = CreateMapStore(folder.File("notes.txt"), TestInfo(), {.overwrite = true}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), HasSubstr("is not a Cairn map"));
  EXPECT_EQ(testing::ReadBytes(folder.File("notes.txt")), "not a map");
  WriteBytes(folder.File("empty"), "");
  EXPECT_TRUE(CreateMapStore(folder.File("empty"), TestInfo(), {.overwrite = true}).ok());
  EXPECT_THAT(folder.Names(), UnorderedElementsAre("notes.txt", "empty"));
}

TEST(SqliteMapCreation, AFileThatAppearsMeanwhileIsNotOverwritten) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  MapGrower grower(9);
  SnapshotPtr map = map::Snapshot::Empty(TestInfo());
  const map::Delta start = grower.Start(map);
  map = *map->Apply(start);
  const map::Delta first = grower.AddKeyframe(map);
  {
    auto store = *CreateMapStore(path, TestInfo());
    ASSERT_TRUE(store->Commit(start).ok());
    WriteBytes(path, "somebody else's");
    EXPECT_EQ(FaultOf(store->Commit(first)), Fault::kExists);
    std::filesystem::remove(path);
    EXPECT_TRUE(store->Commit(first).ok());
  }
  auto store = *CreateMapStore(path, TestInfo(), {.overwrite = true});
  ASSERT_TRUE(store->Commit(start).ok());
  ASSERT_TRUE(store->Commit(first).ok());
  std::filesystem::remove(path);
  WriteBytes(path, "somebody else's");
  const absl::Status closed = store->Close();
  EXPECT_EQ(FaultOf(closed), Fault::kMoved) << closed;
  EXPECT_THAT(std::string(closed.message()), HasSubstr("complete in " + path + "-new"));
  EXPECT_EQ(testing::ReadBytes(path), "somebody else's");
  EXPECT_TRUE(SameBits(*LoadMap(path + "-new"), **map->Apply(first)));
}

}  // namespace
}  // namespace cairn::store

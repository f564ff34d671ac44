// Every call by which a map file is changed fails once: what was acknowledged stays, and nothing else is seen.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "store/testing_failing_vfs.h"
#include "store/testing_files.h"
#include "store/testing_maps.h"

namespace cairn::store {
namespace {

using testing::FailingVfs;
using ::testing::IsEmpty;
using testing::LoadMap;
using testing::MakeMap;
using testing::MapGrower;
using testing::SameBits;
using testing::SnapshotPtr;
using testing::TempFolder;

SnapshotPtr LoadVerified(const std::string& path) {
  EXPECT_THAT(*(*SqliteMapStore::OpenReadOnly(path))->Verify(), IsEmpty());
  return LoadMap(path);
}

// Adds keyframes and removes things, with the n-th call failing; tells whether any did.
bool CommitWithFailure(const std::string& path, int n, bool for_ever) {
  FailingVfs vfs;
  auto store = *SqliteMapStore::Open(path);
  SnapshotPtr map = *store->LoadSnapshot();
  MapGrower grower(static_cast<std::uint64_t>(n), {.features = 30, .new_points = 8});
  vfs.FailAt(n, for_ever);
  SnapshotPtr in_flight;
  for (int change = 0; change < 3; ++change) {
    const map::Delta delta = change == 1 ? grower.Cull(map) : grower.AddKeyframe(map);
    const absl::Status status = store->Commit(delta);
    if (status.ok()) {
      map = *map->Apply(delta);
      continue;
    }
    EXPECT_NE(FaultOf(status), Fault::kNone) << status;
    EXPECT_GT(vfs.failed(), 0);
    if (for_ever) {
      in_flight = *map->Apply(delta);
      break;
    }
    // What failed once can be done again.
    const absl::Status again = store->Commit(delta);
    EXPECT_TRUE(again.ok()) << "call " << n << ": " << again;
    map = *map->Apply(delta);
  }
  const absl::Status closed = store->Close();
  const bool failed = vfs.failed() > 0;
  EXPECT_TRUE(closed.ok() || failed) << closed;
  store.reset();
  vfs.FailAt(0, false);
  // What a disk that failed while it was to sync may have kept nevertheless is whole.
  const SnapshotPtr loaded = LoadVerified(path);
  EXPECT_TRUE(SameBits(*loaded, *map) || (in_flight && SameBits(*loaded, *in_flight))) << "call " << n;
  return failed;
}

TEST(IoFault, OfEveryCallOfACommit) {
  for (const bool for_ever : {false, true}) {
    const TempFolder folder;
    const std::string path = folder.File("a.cairn"), original = folder.File("original");
    MakeMap(original, 1, 6, {.features = 30, .new_points = 8});
    int n = 1;
    for (;; ++n) {
      for (const std::string& name : folder.Names()) {
        if (name != "original") std::filesystem::remove(folder.File(name));
      }
      std::filesystem::copy_file(original, path);
      if (!CommitWithFailure(path, n, for_ever)) break;
    }
    EXPECT_GT(n, 30);
  }
}

TEST(IoFault, OfEveryCallOfAnOpening) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn"), original = folder.File("original");
  const SnapshotPtr map = MakeMap(original, 2, 4, {.features = 30, .new_points = 8});
  for (int n = 1;; ++n) {
    for (const std::string& name : folder.Names()) {
      if (name != "original") std::filesystem::remove(folder.File(name));
    }
    std::filesystem::copy_file(original, path);
    bool failed = false;
    {
      FailingVfs vfs;
      vfs.FailAt(n, /*for_ever=*/true);
      const auto store = SqliteMapStore::Open(path);
      failed = vfs.failed() > 0;
      if (!failed) {
        EXPECT_TRUE(store.ok()) << store.status();
      }
      vfs.FailAt(0, false);
    }
    EXPECT_TRUE(SameBits(*LoadVerified(path), *map)) << "call " << n;
    if (!failed) break;
  }
}

// A map that is to be there whole or not at all; every other time in place of another one.
TEST(IoFault, OfEveryCallOfMakingAWholeMap) {
  map::MapInfo info = testing::TestInfo();
  info.vocabulary_hash = 0;
  const TempFolder folder;
  const std::string path = folder.File("a.cairn"), original = folder.File("original");
  const SnapshotPtr old = MakeMap(original, 2, 2, {.features = 30, .new_points = 8});
  bool failed = true;
  for (int n = 1; failed; n += 3) {  // the others take as long again
    const bool replaces = n % 2 == 0;
    for (const std::string& name : folder.Names()) {
      if (name != "original") std::filesystem::remove(folder.File(name));
    }
    if (replaces) std::filesystem::copy_file(original, path);
    SnapshotPtr made = map::Snapshot::Empty(info);
    FailingVfs vfs;
    vfs.FailAt(n, /*for_ever=*/true);
    const absl::Status written = [&] {
      auto store = CreateMapStore(path, info, {.overwrite = replaces, .whole = true});
      MapGrower grower(3, {.features = 30, .new_points = 8});
      for (int i = 0; i < 2 && store.ok(); ++i) {
        const map::Delta delta = i == 0 ? grower.Start(made) : grower.AddKeyframe(made);
        const absl::Status committed = (*store)->Commit(delta);
        if (!committed.ok()) return committed;
        made = *made->Apply(delta);
      }
      return store.ok() ? (*store)->Close() : store.status();
    }();
    failed = vfs.failed() > 0;
    vfs.FailAt(0, false);
    EXPECT_TRUE(written.ok() || failed) << written;
    ASSERT_EQ(std::filesystem::exists(path), replaces || written.ok()) << "call " << n;
    if (std::filesystem::exists(path)) {
      EXPECT_TRUE(SameBits(*LoadVerified(path), written.ok() ? *made : *old)) << "call " << n;
    }
    EXPECT_TRUE(failed || n > 20);
  }
}

}  // namespace
}  // namespace cairn::store

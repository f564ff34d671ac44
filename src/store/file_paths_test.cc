// Names of maps, and what happens to a map's file while it is open.
#include "store/file_paths.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>

#include "store/testing_files.h"
#include "store/testing_maps.h"
#include "store/writer_lock.h"

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
using testing::ReadBytes;
using testing::SameBits;
using testing::SnapshotPtr;
using testing::TempFolder;
using testing::TestInfo;
using ::testing::UnorderedElementsAre;
using testing::WriteBytes;

std::string Message(const absl::Status& status) { return std::string(status.message()); }

// A store with some keyframes and what it holds.
struct Growing {
  std::unique_ptr<MapStore> store;
  MapGrower grower{5};
  SnapshotPtr map = nullptr;

  absl::Status Change(const map::Delta& delta) {
    CAIRN_RETURN_IF_ERROR(store->Commit(delta));
    map = *map->Apply(delta);
    return absl::OkStatus();
  }
  absl::Status AddKeyframe() { return Change(grower.AddKeyframe(map)); }
};

Growing Grow(std::unique_ptr<MapStore> store, int keyframes) {
  Growing growing{std::move(store)};
  growing.map = map::Snapshot::Empty(TestInfo());
  EXPECT_TRUE(growing.Change(growing.grower.Start(growing.map)).ok());
  for (int i = 0; i < keyframes; ++i) EXPECT_TRUE(growing.AddKeyframe().ok());
  return growing;
}

Growing Create(const std::string& path, int keyframes = 3, CreateOptions options = {}) {
  auto store = CreateMapStore(path, TestInfo(), std::move(options));
  EXPECT_TRUE(store.ok()) << store.status();
  return Grow(*std::move(store), keyframes);
}

void ExpectHolds(const std::string& path, const map::Snapshot& map) { EXPECT_TRUE(SameBits(*LoadMap(path), map)); }

class InFolder {
 public:
  explicit InFolder(const std::string& path) : before_(std::filesystem::current_path()) {
    std::filesystem::current_path(path);
  }
  ~InFolder() { std::filesystem::current_path(before_); }

 private:
  std::filesystem::path before_;
};

TEST(FilePaths, NamesAreNamesOfFiles) {
  for (const char* name : {"file:x.cairn", ":memory:", "a?b#c%41.cairn", "file:y?mode=memory", "-x", "two words",
                           "\xe5\x9c\xb0\xe5\x9b\xb3.cairn", "quote'\".cairn"}) {
    const TempFolder folder;
    const InFolder here(folder.path());
    Growing growing = Create(name);
    ASSERT_TRUE(growing.store->Close().ok());
    EXPECT_THAT(folder.Names(), ElementsAre(name));
    ExpectHolds(name, *growing.map);
    ASSERT_TRUE((*OpenMapStore(name, OpenMode::kRead))->CopyTo(std::string("copy of ") + name).ok());
    ExpectHolds(std::string("copy of ") + name, *growing.map);
    const auto again = OpenMapStore(name, OpenMode::kWrite);
    ASSERT_TRUE(again.ok()) << again.status();
  }
  for (const std::string& name : {std::string(), std::string("a\0b", 3), std::string("postgresql://host/map")}) {
    EXPECT_EQ(CreateMapStore(name, TestInfo()).status().code(), absl::StatusCode::kInvalidArgument) << name;
    EXPECT_FALSE(OpenMapStore(name, OpenMode::kRead).ok());
  }
}

TEST(FilePaths, LongPathsWorkOrAreRefusedBeforeAnythingIsMade) {
  const TempFolder folder;
  std::string parent = folder.path();
  while (parent.size() < 900) {
    parent += "/" + std::string(40, 'd');
    std::filesystem::create_directory(parent);
    const std::string path = parent + "/a.cairn";
    const auto store = CreateMapStore(path, TestInfo());
    if (store.ok()) {
      Growing growing = Grow(CreateMapStore(parent + "/b.cairn", TestInfo()).value(), 1);
      ASSERT_TRUE(growing.store->Close().ok());
      ExpectHolds(parent + "/b.cairn", *growing.map);
      EXPECT_LT(path.size(), 512u);
      std::filesystem::remove(parent + "/b.cairn");
    } else {
      EXPECT_EQ(store.status().code(), absl::StatusCode::kInvalidArgument);
      EXPECT_THAT(Message(store.status()), HasSubstr("use a shorter one"));
      EXPECT_GT(path.size(), 480u);
      EXPECT_TRUE(std::filesystem::is_empty(parent));
    }
  }
  EXPECT_EQ(CreateMapStore(folder.File(std::string(250, 'n')), TestInfo()).status().code(),
            absl::StatusCode::kInvalidArgument);
}

TEST(FilePaths, SymbolicLinksAreWrittenThrough) {
  const TempFolder folder;
  std::filesystem::create_directory(folder.File("real"));
  std::filesystem::create_symlink("real/a.cairn", folder.File("link.cairn"));
  Growing growing = Create(folder.File("link.cairn"));
  ASSERT_TRUE(growing.store->Close().ok());
  EXPECT_TRUE(std::filesystem::is_symlink(folder.File("link.cairn")));
  ExpectHolds(folder.File("real/a.cairn"), *growing.map);
  Growing second = Create(folder.File("link.cairn"), 2, {.overwrite = true});
  ASSERT_TRUE(second.store->Close().ok());
  EXPECT_TRUE(std::filesystem::is_symlink(folder.File("link.cairn")));
  ExpectHolds(folder.File("real/a.cairn"), *second.map);
  EXPECT_THAT(folder.Names(), UnorderedElementsAre("real", "link.cairn"));
}

TEST(FilePaths, HardLinksAreNotWritten) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  const SnapshotPtr map = MakeMap(path, 3, 2);
  std::filesystem::create_hard_link(path, folder.File("b.cairn"));
  EXPECT_THAT(Message(OpenMapStore(path, OpenMode::kWrite).status()), HasSubstr("hard links"));
  ExpectHolds(path, *map);
}

TEST(FilePaths, NetworkFileSystemsAreKnownByName) {
  for (const char* type : {"nfs", "nfs4", "cifs", "smb3", "9p", "fuse.sshfs", "ceph"}) EXPECT_TRUE(IsNetworkType(type));
  for (const char* type : {"ext4", "btrfs", "overlay", "tmpfs", "fuseblk", "fuse.ntfs-3g", "virtiofs", ""}) {
    EXPECT_FALSE(IsNetworkType(type));
  }
  EXPECT_FALSE(NetworkFileSystem("/dev/shm").has_value());
}

TEST(FilePaths, ARemovedMapIsSavedAndTold) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  Growing growing = Create(path);
  std::filesystem::remove(path);
  const absl::Status commit = growing.AddKeyframe();
  EXPECT_EQ(FaultOf(commit), Fault::kMoved) << commit;
  EXPECT_THAT(Message(commit), HasSubstr("removed or moved"));
  const absl::Status closed = growing.store->Close();
  EXPECT_EQ(FaultOf(closed), Fault::kMoved) << closed;
  EXPECT_THAT(Message(closed), HasSubstr("a.cairn.rescued"));
  ExpectHolds(path + ".rescued", *growing.map);
  EXPECT_THAT(folder.Names(), ElementsAre("a.cairn.rescued"));
}

TEST(FilePaths, WithAllThatLiesBesideIt) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  Growing growing = Create(path);
  for (const std::string& name : folder.Names()) std::filesystem::remove(folder.File(name));
  EXPECT_EQ(FaultOf(growing.AddKeyframe()), Fault::kMoved);
  EXPECT_EQ(FaultOf(growing.store->Close()), Fault::kMoved);
  ExpectHolds(path + ".rescued", *growing.map);
  EXPECT_THAT(folder.Names(), ElementsAre("a.cairn.rescued"));
}

TEST(FilePaths, AMovedMapIsCompleteWhereItIs) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  Growing growing = Create(path);
  std::filesystem::rename(path, folder.File("elsewhere.cairn"));
  EXPECT_EQ(FaultOf(growing.AddKeyframe()), Fault::kMoved);
  const absl::Status closed = growing.store->Close();
  EXPECT_EQ(FaultOf(closed), Fault::kMoved);
  EXPECT_THAT(Message(closed), HasSubstr(folder.File("elsewhere.cairn")));
  ExpectHolds(folder.File("elsewhere.cairn"), *growing.map);
  EXPECT_THAT(folder.Names(), ElementsAre("elsewhere.cairn"));
}

TEST(FilePaths, AFileThatWasPutInPlaceOfTheMapIsLeftAlone) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  Growing growing = Create(path);
  const SnapshotPtr other = MakeMap(folder.File("b.cairn"), 9, 2);
  const std::string bytes = ReadBytes(folder.File("b.cairn"));
  std::filesystem::rename(folder.File("b.cairn"), path);
  EXPECT_THAT(Message(growing.AddKeyframe()), HasSubstr("another file was put in its place"));
  const absl::Status closed = growing.store->Close();
  EXPECT_EQ(FaultOf(closed), Fault::kMoved);
  EXPECT_TRUE(ReadBytes(path) == bytes);
  ExpectHolds(path, *other);
  ExpectHolds(path + ".rescued", *growing.map);
}

// As "cp backup.cairn a.cairn" does: the file keeps its identity.
TEST(FilePaths, AFileThatWasCopiedOverTheMapIsLeftAlone) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  MakeMap(path, 20, 3);
  const std::string backup = ReadBytes(path);
  const SnapshotPtr content = LoadMap(path);
  Growing growing{*OpenMapStore(path, OpenMode::kWrite), MapGrower(21), content};
  ASSERT_TRUE(growing.AddKeyframe().ok());
  {
    std::ofstream out(path, std::ios::binary | std::ios::in);
    out << backup;
  }
  const absl::Status commit = growing.AddKeyframe();
  EXPECT_EQ(FaultOf(commit), Fault::kMoved) << commit;
  EXPECT_THAT(Message(commit), HasSubstr("copied over it"));
  EXPECT_EQ(FaultOf(growing.store->Close()), Fault::kMoved);
  EXPECT_TRUE(ReadBytes(path).substr(0, backup.size()) == backup);
  EXPECT_EQ(FaultOf(OpenMapStore(path, OpenMode::kRead).status()), Fault::kForeignLog);
  std::filesystem::remove(path + "-wal");
  ExpectHolds(path, *content);
}

TEST(FilePaths, ALogThatWasRemovedLosesNothing) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  Growing growing = Create(path);
  std::filesystem::remove(path + "-wal");
  EXPECT_EQ(FaultOf(growing.AddKeyframe()), Fault::kMoved);
  EXPECT_TRUE(growing.store->Close().ok());
  ExpectHolds(path, *growing.map);
}

TEST(FilePaths, ALockIsRemovedByItsHolderOnly) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  auto first = *WriterLock::Acquire(path);
  std::filesystem::remove(path + "-lock");
  auto second = *WriterLock::Acquire(path);
  first.reset();
  EXPECT_TRUE(std::filesystem::exists(path + "-lock"));
  EXPECT_TRUE(WriterLock::IsHeld(path));
  const pid_t child = InChild([&] {
    const absl::Status third = WriterLock::Acquire(path).status();
    const std::string holder = "another process (" + std::to_string(getppid()) + ")";
    return FaultOf(third) == Fault::kBusy && Message(third).find(holder) != std::string::npos ? 0 : 1;
  });
  EXPECT_EQ(ExitCode(child), 0);
  second.reset();
  EXPECT_FALSE(WriterLock::IsHeld(path));
  EXPECT_THAT(folder.Names(), IsEmpty());
}

// What an interrupted writer left means nothing to the next.
TEST(FilePaths, LeftoversOfOthersAreNoObstacle) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  const SnapshotPtr map = MakeMap(path, 12, 3);
  WriteBytes(path + "-lock", "999999\n");
  WriteBytes(path + "-shm", std::string(32768, '\x7f'));
  ExpectHolds(path, *map);
  auto store = OpenMapStore(path, OpenMode::kWrite);
  ASSERT_TRUE(store.ok()) << store.status();
  ASSERT_TRUE((*store)->Close().ok());
  EXPECT_THAT(folder.Names(), ElementsAre("a.cairn"));
}

// Needs the right to mount.
TEST(FilePaths, AClosedMapOnAFullDiskIsRead) {
  const TempFolder folder;
  const std::string disk = folder.File("disk");
  std::filesystem::create_directory(disk);
  if (mount("tmpfs", disk.c_str(), "tmpfs", 0, "size=1m") != 0) GTEST_SKIP() << "needs the right to mount a disk";
  const SnapshotPtr map = MakeMap(folder.File("a.cairn"), 13, 3);
  std::filesystem::copy_file(folder.File("a.cairn"), disk + "/a.cairn");
  std::error_code ignored;
  {
    std::ofstream fill(disk + "/fill");
    for (int i = 0; i < 4096 && fill.good(); ++i) fill << std::string(1024, 'f') << std::flush;
  }
  EXPECT_EQ(std::filesystem::space(disk).available, 0u);
  ExpectHolds(disk + "/a.cairn", *map);
  EXPECT_EQ(FaultOf(OpenMapStore(disk + "/a.cairn", OpenMode::kWrite).status()), Fault::kFull);
  ExpectHolds(disk + "/a.cairn", *map);
  EXPECT_EQ(umount(disk.c_str()), 0);
}

TEST(MapNames, AreNotThoseOfWhatStandsBesideAMap) {
  const TempFolder folder;
  for (const char* suffix : {"-wal", "-shm", "-journal", "-lock", "-new"}) {
    const auto created = CreateMapStore(folder.File("office.cairn") + suffix, TestInfo(), {});
    EXPECT_EQ(created.status().code(), absl::StatusCode::kInvalidArgument) << suffix;
    EXPECT_THAT(Message(created.status()), HasSubstr(suffix));
  }
  EXPECT_TRUE(CreateMapStore(folder.File("office-walls.cairn"), TestInfo(), {}).ok());
}

}  // namespace
}  // namespace cairn::store

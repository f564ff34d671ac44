// Maps under other names.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>

#include "store/map_store.h"
#include "store/sqlite_map_store.h"
#include "store/testing_files.h"
#include "store/testing_maps.h"

namespace cairn::store {
namespace {

using testing::ExitCode;
using testing::InChild;
using testing::MapGrower;
using testing::TempFolder;
using testing::TestInfo;

// A map with so many keyframes; with `die` its writer is killed, so that its changes are in the log.
Revision WriteMap(const std::string& path, int keyframes, bool die = false) {
  const pid_t child = InChild([&] {
    map::MapInfo info = TestInfo();
    info.vocabulary_hash = 0;  // none
    auto file = SqliteMapStore::Create(path, info);
    if (!file.ok()) return 1;
    MapGrower grower(1);
    auto map = map::Snapshot::Empty(info);
    for (int i = -1; i < keyframes; ++i) {
      const map::Delta delta = i < 0 ? grower.Start(map) : grower.AddKeyframe(map);
      map = *map->Apply(delta);
      if (!(*file)->Commit(delta).ok()) return 1;
    }
    if (die) kill(getpid(), SIGKILL);
    return (*file)->Close().ok() ? 0 : 1;
  });
  EXPECT_EQ(ExitCode(child), die ? -1 : 0);
  return static_cast<Revision>(keyframes) + 1;
}

Revision RevisionAt(const std::string& path) {
  const auto map = OpenMapStore(path, OpenMode::kRead);
  EXPECT_TRUE(map.ok()) << map.status();
  if (!map.ok()) return 0;
  EXPECT_THAT(*(*map)->Verify(), ::testing::IsEmpty());
  return *(*map)->ReadRevision();
}

TEST(MapMove, WithWhatAKilledWriterLeft) {
  for (const bool die : {false, true}) {
    const TempFolder folder;
    std::filesystem::create_directory(folder.File("trash"));
    const Revision revision = WriteMap(folder.File("a.cairn"), 3, die);
    EXPECT_EQ(std::filesystem::exists(folder.File("a.cairn-wal")), die);
    const absl::Status moved = MoveMapStore(folder.File("a.cairn"), folder.File("trash/b.cairn"));
    ASSERT_TRUE(moved.ok()) << moved;
    EXPECT_EQ(RevisionAt(folder.File("trash/b.cairn")), revision);
    EXPECT_THAT(folder.Names(), ::testing::ElementsAre("trash")) << "neither the file nor its log";
  }
}

// Where there is no room to put the log into the file: what is to be thrown away must not need any.
TEST(MapMove, OnAFullDiskTheLogGoesAlong) {
  const TempFolder folder;
  std::filesystem::create_directory(folder.File("trash"));
  const Revision revision = WriteMap(folder.File("a.cairn"), 3, /*die=*/true);
  const pid_t child = InChild([&] {
    std::signal(SIGXFSZ, SIG_IGN);
    const auto bytes = static_cast<rlim_t>(std::filesystem::file_size(folder.File("a.cairn")));
    const rlimit limit{bytes, bytes};
    if (setrlimit(RLIMIT_FSIZE, &limit) != 0) return 1;
    return MoveMapStore(folder.File("a.cairn"), folder.File("trash/b.cairn")).ok() ? 0 : 2;
  });
  ASSERT_EQ(ExitCode(child), 0);
  EXPECT_TRUE(std::filesystem::exists(folder.File("trash/b.cairn-wal")));
  EXPECT_THAT(folder.Names(), ::testing::ElementsAre("trash"));
  // And back, with room again.
  ASSERT_TRUE(MoveMapStore(folder.File("trash/b.cairn"), folder.File("a.cairn")).ok());
  EXPECT_THAT(folder.Names(), ::testing::ElementsAre("a.cairn", "trash"));
  EXPECT_EQ(RevisionAt(folder.File("a.cairn")), revision);
}

TEST(MapMove, ReadersNotice) {
  const TempFolder folder;
  WriteMap(folder.File("a.cairn"), 2);
  const auto reader = *OpenMapStore(folder.File("a.cairn"), OpenMode::kRead);
  ASSERT_TRUE(reader->LoadSnapshot().ok());
  ASSERT_TRUE(MoveMapStore(folder.File("a.cairn"), folder.File("b.cairn")).ok());
  EXPECT_EQ(FaultOf(reader->ReadRevision().status()), Fault::kMoved);
}

// As by cp, which keeps the file's number: SQLite itself goes on with what it has read.
TEST(MapMove, ReadersNoticeWhatIsWrittenOverTheFile) {
  const TempFolder folder;
  const auto write_over = [&](const std::string& bytes) {
    std::ofstream(folder.File("a.cairn"), std::ios::binary | std::ios::in | std::ios::out | std::ios::trunc) << bytes;
  };
  const auto bytes_of = [&](const std::string& name) {
    std::ifstream file(folder.File(name), std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(file), {});
  };
  const Revision revision = WriteMap(folder.File("a.cairn"), 3);
  WriteMap(folder.File("b.cairn"), 2);
  const std::string original = bytes_of("a.cairn");
  for (const std::string& other :
       {bytes_of("b.cairn"), std::string("this is no map"), std::string(), original.substr(0, original.size() / 2)}) {
    write_over(original);
    const auto reader = *OpenMapStore(folder.File("a.cairn"), OpenMode::kRead);
    ASSERT_TRUE(reader->LoadSnapshot().ok());
    EXPECT_EQ(*reader->ReadRevision(), revision);
    write_over(other);
    EXPECT_EQ(FaultOf(reader->ReadRevision().status()), Fault::kMoved) << other.size() << " bytes";
  }
  // One that was only touched is the same map.
  write_over(original);
  const auto reader = *OpenMapStore(folder.File("a.cairn"), OpenMode::kRead);
  write_over(original);
  EXPECT_EQ(*reader->ReadRevision(), revision);
}

TEST(MapMove, WhatStandsAgainstIt) {
  const TempFolder folder;
  const Revision revision = WriteMap(folder.File("a.cairn"), 2);
  WriteMap(folder.File("b.cairn"), 1);
  EXPECT_EQ(FaultOf(MoveMapStore(folder.File("a.cairn"), folder.File("b.cairn"))), Fault::kExists);
  EXPECT_EQ(FaultOf(MoveMapStore(folder.File("c.cairn"), folder.File("d.cairn"))), Fault::kNotFound);
  EXPECT_EQ(MoveMapStore(folder.File("a.cairn"), folder.File("a.cairn-wal")).code(),
            absl::StatusCode::kInvalidArgument);
  {
    const auto writer = OpenMapStore(folder.File("a.cairn"), OpenMode::kWrite);
    ASSERT_TRUE(writer.ok()) << writer.status();
    EXPECT_EQ(FaultOf(MoveMapStore(folder.File("a.cairn"), folder.File("d.cairn"))), Fault::kBusy);
  }
  std::filesystem::create_symlink(folder.File("a.cairn"), folder.File("link.cairn"));
  EXPECT_EQ(MoveMapStore(folder.File("link.cairn"), folder.File("d.cairn")).code(),
            absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(RevisionAt(folder.File("a.cairn")), revision);
  EXPECT_FALSE(std::filesystem::exists(folder.File("d.cairn")));
}

TEST(MapMove, AlsoWhatIsDamaged) {
  const TempFolder folder;
  std::ofstream(folder.File("a.cairn")) << "this is no map";
  EXPECT_TRUE(MoveMapStore(folder.File("a.cairn"), folder.File("b.cairn")).ok());
  EXPECT_TRUE(std::filesystem::exists(folder.File("b.cairn")));
  std::ofstream(folder.File("empty.cairn")).flush();
  EXPECT_TRUE(MoveMapStore(folder.File("empty.cairn"), folder.File("c.cairn")).ok());
  EXPECT_TRUE(std::filesystem::exists(folder.File("c.cairn")));
}

}  // namespace
}  // namespace cairn::store

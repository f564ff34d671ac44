// A write-ahead log is replayed onto the map that it was written for, and onto no other.
#include "store/write_ahead_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>

#include "store/map_overview.h"
#include "store/row.h"
#include "store/testing_files.h"
#include "store/testing_maps.h"

namespace cairn::store {
namespace {

using testing::Bits;
using ::testing::Contains;
using ::testing::ElementsAre;
using testing::ExitCode;
using ::testing::HasSubstr;
using testing::InChild;
using ::testing::IsEmpty;
using testing::LoadMap;
using testing::MakeMap;
using testing::MapGrower;
using ::testing::Not;
using testing::ReadBytes;
using testing::SameBits;
using testing::SnapshotPtr;
using testing::TempFolder;
using testing::TestInfo;
using testing::WriteBytes;
using testing::WriteForever;

// Extends the map at `path` and is killed, so that its last changes are in the log; returns the last revision that was
// acknowledged.
Revision ExtendAndBeKilled(const std::string& path, std::uint64_t seed, int changes = 5) {
  int ends[2];
  EXPECT_EQ(pipe(ends), 0);
  const pid_t child = InChild([&] { return WriteForever(path, seed, ends[1]); });
  close(ends[1]);
  Revision revision = 0;
  for (int i = 0; i < changes; ++i) {
    EXPECT_EQ(read(ends[0], &revision, sizeof(revision)), static_cast<ssize_t>(sizeof(revision)));
  }
  kill(child, SIGKILL);
  while (read(ends[0], &revision, sizeof(revision)) == sizeof(revision)) {
  }
  close(ends[0]);
  EXPECT_EQ(ExitCode(child), -1);
  EXPECT_GT(std::filesystem::file_size(path + "-wal"), 0u);
  return revision;
}

// Reading and writing refuse the log, change nothing, and say how to go on; then that works.
void ExpectRefused(const std::string& path, const map::Snapshot& content) {
  const std::string file = ReadBytes(path), log = ReadBytes(path + "-wal");
  for (const absl::Status& status :
       {SqliteMapStore::OpenReadOnly(path).status(), SqliteMapStore::Open(path).status()}) {
    EXPECT_EQ(FaultOf(status), Fault::kForeignLog) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr("mv '" + path + "-wal'"));
  }
  EXPECT_TRUE(ReadBytes(path) == file);
  EXPECT_TRUE(ReadBytes(path + "-wal") == log);
  std::filesystem::rename(path + "-wal", path + "-wal.old");
  EXPECT_TRUE(SameBits(*LoadMap(path), content));
  const auto writer = SqliteMapStore::Open(path);
  ASSERT_TRUE(writer.ok()) << writer.status();
  EXPECT_TRUE(SameBits(**(*writer)->LoadSnapshot(), content));
  std::filesystem::remove(path + "-wal.old");
}

TEST(WriteAheadLog, OfAKilledWriterIsReplayed) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  MakeMap(path, 1, 4);
  for (std::uint64_t trial = 0; trial < 4; ++trial) {
    const Revision acknowledged = ExtendAndBeKilled(path, trial);
    EXPECT_TRUE(CheckLog(path).ok()) << CheckLog(path);
    if (trial % 2 == 0) {
      EXPECT_GE(LoadMap(path)->revision(), acknowledged);
    }
  }
  EXPECT_THAT(*(*SqliteMapStore::Open(path))->Verify(), IsEmpty());
}

TEST(WriteAheadLog, IsNotReplayedOntoAnotherMap) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn"), other = folder.File("b.cairn");
  MakeMap(path, 2, 4);
  map::MapInfo info = TestInfo();
  info.id[3] = 'a';
  MapGrower grower(3);
  SnapshotPtr map = map::Snapshot::Empty(info);
  {
    auto store = *SqliteMapStore::Create(other, info);
    for (int i = 0; i < 4; ++i) {
      const map::Delta delta = i == 0 ? grower.Start(map) : grower.AddKeyframe(map);
      ASSERT_TRUE(store->Commit(delta).ok());
      map = *map->Apply(delta);
    }
  }
  ExtendAndBeKilled(path, 4);
  WriteBytes(path, ReadBytes(other));
  ExpectRefused(path, *map);
}

// Six tries, as backups are made: before the run, at other revisions, with other sizes of log.
// The writer is alive: its log must not be moved away.
TEST(WriteAheadLog, OfAMapThatIsReplacedWhileItIsWrittenIsLeftAlone) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn"), other = folder.File("b.cairn");
  MakeMap(path, 2, 4);
  MakeMap(other, 3, 6);
  MapGrower grower(4);
  auto writer = *SqliteMapStore::Open(path);
  ASSERT_TRUE(writer->Commit(grower.AddKeyframe(*writer->LoadSnapshot())).ok());
  std::filesystem::rename(other, path);
  const absl::Status refused = SqliteMapStore::OpenReadOnly(path).status();
  EXPECT_EQ(FaultOf(refused), Fault::kForeignLog) << refused;
  EXPECT_THAT(std::string(refused.message()), HasSubstr(".rescued"));
  EXPECT_THAT(std::string(refused.message()), ::testing::Not(HasSubstr("mv '")));
  EXPECT_EQ(FaultOf(writer->Close()), Fault::kMoved);
  EXPECT_TRUE(std::filesystem::exists(path + ".rescued"));
}

TEST(WriteAheadLog, IsNotReplayedOntoABackup) {
  for (int trial = 0; trial < 6; ++trial) {
    const TempFolder folder;
    const std::string path = folder.File("a.cairn"), backup = folder.File("backup.cairn");
    MakeMap(path, static_cast<std::uint64_t>(10 + trial), 3 + trial);
    std::filesystem::copy_file(path, backup);
    const SnapshotPtr content = LoadMap(backup);
    // Backups of one session before, too.
    if (trial % 2 == 1) {
      MapGrower grower(7);
      auto store = *SqliteMapStore::Open(path);
      SnapshotPtr map = *store->LoadSnapshot();
      ASSERT_TRUE(store->Commit(grower.AddKeyframe(map)).ok());
    }
    ExtendAndBeKilled(path, static_cast<std::uint64_t>(20 + trial), 1 + 2 * trial);
    WriteBytes(path, ReadBytes(backup));
    ExpectRefused(path, *content);
  }
}

TEST(WriteAheadLog, IsNotReplayedOntoACopyMadeMeanwhile) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  MakeMap(path, 30, 4);
  for (const bool vacuum : {false, true}) {
    const std::string copy = folder.File(vacuum ? "copy.cairn" : "sqlite_copy.cairn");
    SnapshotPtr content;
    const pid_t child = InChild([&] {
      auto store = *SqliteMapStore::Open(path);
      SnapshotPtr map = *store->LoadSnapshot();
      MapGrower grower(31);
      const auto change = [&] {
        const map::Delta delta = grower.AddKeyframe(map);
        if (!store->Commit(delta).ok()) _exit(1);
        map = *map->Apply(delta);
      };
      change();
      if (vacuum) {
        if (!store->CopyTo(copy).ok()) _exit(2);
      } else if (std::system(("sqlite3 " + path + " \"VACUUM INTO '" + copy + "'\"").c_str()) != 0) {
        _exit(3);
      }
      change();
      change();
      kill(getpid(), SIGKILL);
      return 0;
    });
    const int code = ExitCode(child);
    if (code == 3) GTEST_SKIP() << "needs the sqlite3 command";
    ASSERT_EQ(code, -1);
    content = LoadMap(copy);
    WriteBytes(path, ReadBytes(copy));
    ExpectRefused(path, *content);
  }
}

TEST(WriteAheadLog, OfNothingButAnOpeningIsNoObstacle) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  const SnapshotPtr map = MakeMap(path, 40, 4);
  // A reader at work keeps the log from being emptied.
  auto reader = *Database::OpenFile(path, Database::Mode::kQueryOnly);
  const Transaction reading = *Transaction::Begin(reader.get(), Transaction::Kind::kRead);
  ASSERT_EQ(*reader->QueryInt("SELECT count(*) FROM keyframes"), 4);
  const pid_t child = InChild([&] {
    auto store = SqliteMapStore::Open(path);
    if (!store.ok()) return 1;
    kill(getpid(), SIGKILL);
    return 0;
  });
  ASSERT_EQ(ExitCode(child), -1);
  EXPECT_TRUE(CheckLog(path).ok()) << CheckLog(path);
  EXPECT_TRUE(SameBits(*LoadMap(path), *map));
}

TEST(WriteAheadLog, IsKnownAfterCompaction) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  MakeMap(path, 50, 6);
  {
    auto store = *SqliteMapStore::Open(path);
    ASSERT_TRUE(store->Compact().ok());
  }
  const Revision acknowledged = ExtendAndBeKilled(path, 51);
  EXPECT_GE(LoadMap(path)->revision(), acknowledged);
  // The row of table `map` is still where the log is known by.
  const std::string bytes = ReadBytes(path);
  const auto state = ParseMapPage(AsBytes(absl::string_view(bytes).substr(4096, 4096)));
  ASSERT_TRUE(state.has_value());
  EXPECT_EQ(state->map_id, TestInfo().id);
  EXPECT_EQ(state->log_token.size(), 32u);
}

TEST(WriteAheadLog, ForeignJournalIsRefused) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  MakeMap(path, 60, 2);
  WriteBytes(path + "-journal", "anything");
  EXPECT_EQ(FaultOf(SqliteMapStore::OpenReadOnly(path).status()), Fault::kForeignLog);
  EXPECT_EQ(FaultOf(SqliteMapStore::Open(path).status()), Fault::kForeignLog);
}

// A bit in the middle of the log: SQLite would go on from before it without a word.
TEST(WriteAheadLog, DamageIsTold) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn"), log = path + "-wal";
  MakeMap(path, 4, 6);
  const Revision acknowledged = ExtendAndBeKilled(path, 5, 12);
  const std::string file = ReadBytes(path), good = ReadBytes(log);
  Random random(6);
  int told = 0;
  for (int trial = 0; trial < 60; ++trial) {
    std::string damaged = good;
    const std::size_t at = trial < 20 ? random.Below(56) : random.Below(good.size());
    damaged[at] = static_cast<char>(static_cast<unsigned>(damaged[at]) ^ 1u << random.Below(8));
    WriteBytes(path, file);
    WriteBytes(log, damaged);
    auto store = SqliteMapStore::OpenReadOnly(path);
    ASSERT_TRUE(store.ok()) << at << store.status();
    const Revision revision = *(*store)->ReadRevision();
    if (revision < acknowledged) {
      ASSERT_THAT((*store)->notes(), Contains(HasSubstr(log))) << at;
      EXPECT_THAT(*(*store)->Verify(), Not(IsEmpty()));
      EXPECT_TRUE(IsDamaged((*store)->CopySound(folder.File("copy.cairn"))));
      EXPECT_FALSE(std::filesystem::exists(folder.File("copy.cairn")));
      EXPECT_THAT(ReadMapOverview(path)->notes, Contains(HasSubstr(log))) << at;
      // Who only reads does not do away with what is behind the damage: the next one is told the same.
      store->reset();
      EXPECT_EQ(ReadBytes(log), damaged);
      EXPECT_EQ(ReadBytes(path), file);
      // Who writes does, and keeps a copy.
      EXPECT_TRUE(SqliteMapStore::Open(path).ok());
      EXPECT_EQ(ReadBytes(log + ".damaged"), damaged);
      ++told;
    } else {
      EXPECT_THAT((*store)->notes(), IsEmpty()) << at;
    }
    store->reset();
    for (const char* suffix : {"-wal", "-shm", "-wal.damaged"}) unlink((path + suffix).c_str());
  }
  EXPECT_GT(told, 20);
}

// What a power failure leaves is no damage: of a change that nobody was told of, some pages are there.
TEST(WriteAheadLog, ALastChangeThatWasCutOffIsNoDamage) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn"), log = path + "-wal";
  MakeMap(path, 4, 6);
  ExtendAndBeKilled(path, 5);
  const std::string file = ReadBytes(path), good = ReadBytes(log);
  constexpr std::size_t kFrameBytes = 24 + 4096;
  for (std::size_t cut = 1; cut < 6; ++cut) {
    WriteBytes(path, file);
    WriteBytes(log, good.substr(0, 32 + (good.size() - 32) / kFrameBytes * kFrameBytes - cut * kFrameBytes / 2));
    auto store = SqliteMapStore::OpenReadOnly(path);
    ASSERT_TRUE(store.ok()) << store.status();
    EXPECT_THAT((*store)->notes(), IsEmpty());
    EXPECT_THAT(*(*store)->Verify(), IsEmpty());
    store->reset();
    for (const char* suffix : {"-wal", "-shm"}) unlink((path + suffix).c_str());
  }
}

TEST(WriteAheadLog, RandomBytesAreNoLog) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  const SnapshotPtr map = MakeMap(path, 70, 3);
  Random random(71);
  ExtendAndBeKilled(path, 72);
  const std::string file = ReadBytes(path), log = ReadBytes(path + "-wal");
  for (int trial = 0; trial < 60; ++trial) {
    std::string damaged = log;
    for (int i = 0; i < 3; ++i) damaged[random.Below(damaged.size())] ^= static_cast<char>(1 + random.Below(255));
    damaged.resize(damaged.size() - random.Below(damaged.size()));
    WriteBytes(path, file);
    WriteBytes(path + "-wal", damaged);
    std::filesystem::remove(path + "-shm");
    const absl::Status checked = CheckLog(path);
    if (!checked.ok()) {
      EXPECT_EQ(FaultOf(checked), Fault::kForeignLog);
      continue;
    }
    EXPECT_GE(LoadMap(path)->revision(), map->revision());
  }
  // Pages that are not of the kind.
  for (int trial = 0; trial < 2000; ++trial) {
    std::vector<std::uint8_t> page(4096);
    for (std::uint8_t& byte : page) byte = static_cast<std::uint8_t>(random.Below(256));
    page[0] = 13, page[3] = 0, page[4] = 1;
    ParseMapPage(page);
  }
}

}  // namespace
}  // namespace cairn::store

// What a map file and its users go through: damage, killed writers, full disks, read-only media, readers beside a
// writer.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <limits>
#include <set>

#include "store/row.h"
#include "store/sqlite.h"
#include "store/sqlite_map_store.h"
#include "store/sqlite_record.h"
#include "store/testing_files.h"
#include "store/testing_maps.h"

namespace cairn::store {
namespace {

using testing::Bits;
using ::testing::ElementsAre;
using testing::ExitCode;
using ::testing::HasSubstr;
using testing::InChild;
using ::testing::IsEmpty;
using testing::LoadMap;
using testing::MakeMap;
using testing::MapGrower;
using testing::ReadBytes;
using testing::SnapshotPtr;
using testing::TempFolder;
using testing::TestInfo;
using testing::WriteBytes;
using testing::WriteForever;

// What reading the file comes to; never more than an error, and never other content than `good`.
struct Reading {
  absl::Status status;
  bool loaded = false;
  bool has_findings = false;
};

Reading ReadAll(const std::string& path, const Bits& good) {
  Reading reading;
  auto file = SqliteMapStore::OpenReadOnly(path);
  if (!file.ok()) {
    reading.status = file.status();
    return reading;
  }
  const auto map = (*file)->LoadSnapshot();
  reading.status = map.status();
  reading.loaded = map.ok();
  if (map.ok()) {
    EXPECT_EQ(Bits(**map), good);
  }
  const auto vocabulary = (*file)->LoadVocabulary();
  if (vocabulary.ok()) {
    EXPECT_EQ(*vocabulary, std::string(9000, 'w'));
  }
  const auto findings = (*file)->Verify();
  if (!findings.ok()) {
    reading.status = findings.status();
    reading.loaded = false;
    return reading;
  }
  reading.has_findings = !findings->empty();
  // What cannot be loaded is found.
  EXPECT_TRUE(reading.loaded || reading.has_findings) << map.status();
  return reading;
}

TEST(MapFaults, NotAMap) {
  const TempFolder folder;
  const auto fault = [&](const std::string& name) {
    const absl::Status reading = SqliteMapStore::OpenReadOnly(folder.File(name)).status();
    const absl::Status writing = SqliteMapStore::Open(folder.File(name)).status();
    EXPECT_EQ(FaultOf(reading), FaultOf(writing)) << reading << writing;
    EXPECT_THAT(std::string(reading.message()), HasSubstr(folder.File(name)));
    return FaultOf(reading);
  };
  EXPECT_EQ(fault("missing.cairn"), Fault::kNotFound);
  EXPECT_EQ(fault("missing/a.cairn"), Fault::kNotFound);
  EXPECT_EQ(fault("."), Fault::kNotAMap);
  WriteBytes(folder.File("empty"), "");
  EXPECT_EQ(fault("empty"), Fault::kNotAMap);
  WriteBytes(folder.File("text"), "hello");
  EXPECT_EQ(fault("text"), Fault::kNotAMap);
  WriteBytes(folder.File("noise"), std::string(100000, '\x55'));
  EXPECT_EQ(fault("noise"), Fault::kNotAMap);
  ASSERT_EQ(mkfifo(folder.File("pipe").c_str(), 0600), 0);
  EXPECT_EQ(fault("pipe"), Fault::kNotAMap);
  {
    auto other = *Database::OpenFile(folder.File("other"), Database::Mode::kCreate);
    ASSERT_TRUE(other->Execute("CREATE TABLE t (a)").ok());
  }
  EXPECT_EQ(fault("other"), Fault::kNotAMap);
  std::set<std::string> names;
  for (const std::string& name : folder.Names()) names.insert(name);
  EXPECT_THAT(names, ElementsAre("empty", "noise", "other", "pipe", "text"));
}

TEST(MapFaults, NewerVersion) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  MakeMap(path, 1, 2);
  ASSERT_TRUE((*Database::OpenFile(path, Database::Mode::kReadWrite))
                  ->Execute("PRAGMA user_version = 7; ALTER TABLE points ADD COLUMN of_the_future")
                  .ok());
  for (const absl::Status& status :
       {SqliteMapStore::OpenReadOnly(path).status(), SqliteMapStore::Open(path).status()}) {
    EXPECT_TRUE(IsNewerVersion(status)) << status;
    EXPECT_EQ(status.code(), absl::StatusCode::kUnimplemented);
    EXPECT_THAT(std::string(status.message()), HasSubstr("format 7"));
    EXPECT_THAT(std::string(status.message()), HasSubstr("up to " + std::to_string(SupportedFormatVersion())));
  }
}

TEST(MapFaults, ContentThatDoesNotFitItsChecksumIsNamed) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  const auto expect_finding = [&](const std::string& sql, const std::string& table, std::int64_t id) {
    MakeMap(path, 2, 5);
    {
      auto database = *Database::OpenFile(path, Database::Mode::kReadWrite);
      const absl::Status status = database->Execute("PRAGMA foreign_keys = OFF; " + sql);
      ASSERT_TRUE(status.ok()) << status;
    }
    auto file = SqliteMapStore::OpenReadOnly(path);
    if (file.ok()) {
      bool found = false;
      const auto findings = (*file)->Verify();
      ASSERT_TRUE(findings.ok()) << findings.status();
      for (const Finding& finding : *findings) found = found || (finding.table == table && finding.id == id);
      EXPECT_TRUE(found) << sql;
    }
    // The log and the views matter to people only.
    if (table == "changes" || table == "touched" || table == "overview" || table == "vocabulary") return;
    const absl::Status status = file.ok() ? (*file)->LoadSnapshot().status() : file.status();
    EXPECT_TRUE(IsDamaged(status)) << sql << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr(table)) << sql;
  };
  expect_finding("UPDATE map SET name = 'other'", "map", 1);
  expect_finding("UPDATE cameras SET fx_px = 1.0", "cameras", 1);
  expect_finding("UPDATE sessions SET complete = 1", "sessions", 1);
  expect_finding("INSERT INTO loops VALUES (1, 1, 2, 0, 1, 0, 50, 1.0, 0.0, 0.0, 0.0, 5)", "loops", 1);
  expect_finding("INSERT INTO reported_trajectories VALUES (1, 1, 5, 2, 'x', 5)", "reported_trajectories", 1);
  expect_finding("UPDATE components SET revision = 1", "components", 1);
  expect_finding("UPDATE touched SET ids = x'0101' WHERE revision = 3", "touched", 3);
  expect_finding("UPDATE keyframes SET time_ns = 1 WHERE id = 3", "keyframes", 3);
  expect_finding("UPDATE keyframe_features SET keypoints = zeroblob(540) WHERE keyframe = 2", "keyframe_features", 2);
  expect_finding("UPDATE keyframe_features SET words = zeroblob(180) WHERE keyframe = 2", "keyframe_features", 2);
  expect_finding("UPDATE keyframe_points SET point_ids = zeroblob(60) WHERE keyframe = 4", "keyframe_points", 4);
  expect_finding("UPDATE points SET z = -z WHERE id = 17", "points", 17);
  expect_finding("UPDATE covisibility SET shared_points = 99 WHERE keyframe_a = 2", "covisibility", 2);
  expect_finding("UPDATE vocabulary SET bytes = 'x'", "vocabulary", 1);
  expect_finding("UPDATE changes SET reason = 'x' WHERE revision = 2", "changes", 2);
  expect_finding("DELETE FROM points WHERE id = 17", "points", 0);
  expect_finding("UPDATE points SET id = 2000000 WHERE id = 17", "points", 2000000);
  expect_finding("PRAGMA ignore_check_constraints = ON; UPDATE points SET id = -5 WHERE id = 17", "points", -5);
  expect_finding("DELETE FROM covisibility WHERE keyframe_a = 2", "covisibility", 0);
  expect_finding("DELETE FROM keyframe_points WHERE keyframe = 2", "keyframe_points", 0);
  expect_finding("DELETE FROM keyframe_features WHERE keyframe = 2", "keyframe_features", 2);
  expect_finding("DELETE FROM map", "map", 0);
  expect_finding("DROP TABLE points", "points", 0);
  expect_finding("DROP VIEW overview", "overview", 0);
}

// What is on the list of free pages is overwritten by the next change.
TEST(MapFaults, AListOfFreePagesThatCannotBeIsNamed) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  MakeMap(path, 2, 5);
  {
    auto database = *Database::OpenFile(path, Database::Mode::kReadWrite);
    ASSERT_TRUE(database
                    ->Execute("CREATE TABLE junk (b BLOB); INSERT INTO junk VALUES (zeroblob(60000)); DROP TABLE junk; "
                              "PRAGMA wal_checkpoint(TRUNCATE)")
                    .ok());
  }
  const std::string good = ReadBytes(path);
  const auto number_at = [&](std::size_t at) { return BigEndian32(reinterpret_cast<const std::uint8_t*>(&good[at])); };
  constexpr std::size_t kPageBytes = 4096, kFirstTrunk = 32, kCount = 36;
  ASSERT_EQ(PageBytesOf(AsBytes(good)), kPageBytes);
  const std::size_t leaf = (number_at(kFirstTrunk) - 1) * kPageBytes + 8;
  ASSERT_GT(number_at(kCount), 5u);
  const auto findings_with = [&](std::size_t at, std::uint32_t number) {
    std::string bad = good;
    for (int i = 0; i < 4; ++i) bad[at + static_cast<std::size_t>(i)] = static_cast<char>(number >> (24 - 8 * i));
    WriteBytes(path, bad);
    return *(*SqliteMapStore::OpenReadOnly(path))->Verify();
  };
  EXPECT_THAT(findings_with(leaf, number_at(leaf)), IsEmpty());
  const auto names = [](const std::string& what) {
    return ::testing::Contains(::testing::Field(&Finding::message, HasSubstr(what)));
  };
  constexpr std::uint32_t kInUse = 4;
  EXPECT_THAT(findings_with(leaf, kInUse),
              ::testing::AllOf(names("page 4 is in use"), names("is neither free nor in use")));
  EXPECT_THAT(findings_with(leaf, number_at(leaf + 4)), names("list of free pages"));
  EXPECT_THAT(findings_with(kFirstTrunk, number_at(kFirstTrunk) ^ 1u << 21), names("list of free pages"));
  EXPECT_THAT(findings_with(kCount, number_at(kCount) + 1), names("list of free pages"));
}

// Whoever writes such files makes checksums that fit.
TEST(MapFaults, ValuesOutOfRangeAreDamage) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  const auto expect_damage = [&](const std::string& column, std::size_t at, const std::string& bytes,
                                 const std::string& message) {
    MakeMap(path, 21, 3);
    {
      auto database = *Database::OpenFile(path, Database::Mode::kReadWrite);
      // A vocabulary of 100000 words, as far as its head tells.
      std::string vocabulary = "CAIRNVOC" + std::string(16, '\0');
      const std::uint32_t num_words = 100000;
      vocabulary.append(reinterpret_cast<const char*>(&num_words), sizeof(num_words));
      Statement put = *database->Prepare("UPDATE vocabulary SET bytes = ?, bytes_checksum = ?");
      put.Bind(1, AsBytes(vocabulary));
      put.Bind(2, BlobChecksum(AsBytes(vocabulary)));
      ASSERT_TRUE(put.Run().ok());
      Statement get = *database->Prepare("SELECT " + column + " FROM keyframe_features WHERE keyframe = 2");
      ASSERT_TRUE(*get.Step());
      const Bytes blob = get.Blob(0);
      std::string changed(reinterpret_cast<const char*>(blob.data()), blob.size());
      get.Reset();
      ASSERT_LE(at + bytes.size(), changed.size());
      changed.replace(at, bytes.size(), bytes);
      Statement update = *database->Prepare("UPDATE keyframe_features SET " + column + " = ?, " + column +
                                            "_checksum = ? WHERE keyframe = 2");
      update.Bind(1, AsBytes(changed));
      update.Bind(2, BlobChecksum(AsBytes(changed)));
      ASSERT_TRUE(update.Run().ok());
    }
    const absl::Status status = (*SqliteMapStore::OpenReadOnly(path))->LoadSnapshot().status();
    EXPECT_EQ(IsDamaged(status), !message.empty()) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr(message));
  };
  // 60 features: x and y of 2 bytes each, angles of 4, octaves of 1.
  constexpr std::size_t kX = 0, kAngle = 4 * 60, kOctave = 8 * 60;
  const auto bytes_of = [](auto value) { return std::string(reinterpret_cast<const char*>(&value), sizeof(value)); };
  expect_damage("keypoints", kOctave + 3, bytes_of(std::uint8_t{7}), "");
  expect_damage("keypoints", kOctave + 3, bytes_of(std::uint8_t{8}), "octave");
  expect_damage("keypoints", kOctave + 59, bytes_of(std::uint8_t{255}), "octave");
  expect_damage("keypoints", kAngle, bytes_of(std::numeric_limits<float>::quiet_NaN()), "angle");
  expect_damage("keypoints", kAngle + 8, bytes_of(1e30f), "angle");
  expect_damage("keypoints", kX + 10, bytes_of(std::uint16_t{65535}), "outside");
  expect_damage("words", 0, std::string("\x9f\x86\x01", 3), "");
  expect_damage("words", 0, std::string("\xa0\x86\x01", 3), "vocabulary");
}

TEST(MapFaults, FlippedBytesAreFoundOrHarmless) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn"), broken = folder.File("b.cairn");
  const SnapshotPtr map = MakeMap(path, 3, 5, {.features = 600, .new_points = 225});
  const Bits good(*map);
  const std::string bytes = ReadBytes(path);
  Random random(4);
  int found = 0, harmless = 0;
  for (int trial = 0; trial < 320; ++trial) {
    std::string damaged = bytes;
    // Single bits, bytes, and runs; every fourth time in the first pages, which hold the header and the table
    // definitions.
    const std::size_t range = trial % 4 == 0 ? 12288 : bytes.size();
    const std::size_t at = random.Below(std::min(range, bytes.size()));
    const std::size_t length = trial % 3 == 0 ? 1 + random.Below(64) : 1;
    for (std::size_t i = at; i < std::min(at + length, bytes.size()); ++i) {
      const auto flip = trial % 2 == 0 ? 1u << random.Below(8) : 1u + random.Below(255);
      damaged[i] = static_cast<char>(static_cast<unsigned>(damaged[i]) ^ flip);
    }
    WriteBytes(broken, damaged);
    const Reading reading = ReadAll(broken, good);
    (reading.loaded && !reading.has_findings ? harmless : found) += 1;
    if (!reading.status.ok()) {
      EXPECT_NE(FaultOf(reading.status), Fault::kNone) << reading.status;
    }
    for (const char* suffix : {"-wal", "-shm"}) unlink((broken + suffix).c_str());
  }
  std::printf("%d of %d damages found, the others harmless\n", found, found + harmless);
  EXPECT_GT(found, harmless);
}

TEST(MapFaults, FlippedBitsOfTheHeaderAreFoundOrHarmless) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn"), broken = folder.File("b.cairn");
  const Bits good(*MakeMap(path, 3, 4));
  const std::string bytes = ReadBytes(path);
  constexpr std::size_t kHeaderBytes = 100, kMagicBytes = 16;
  for (std::size_t bit = 0; bit < kHeaderBytes * 8; bit += 3) {
    std::string damaged = bytes;
    damaged[bit / 8] = static_cast<char>(static_cast<unsigned>(damaged[bit / 8]) ^ 1u << bit % 8);
    WriteBytes(broken, damaged);
    const Reading reading = ReadAll(broken, good);
    // Nobody is told to update Cairn, or that it is no map, for one bit.
    if (!reading.status.ok() && bit / 8 >= kMagicBytes) {
      EXPECT_TRUE(IsDamaged(reading.status)) << bit << reading.status;
    }
    for (const char* suffix : {"-wal", "-shm"}) unlink((broken + suffix).c_str());
  }
}

TEST(MapFaults, AHeaderThatSaysALowerFormatIsFound) {
  const TempFolder folder;
  for (int format = 1; format <= 3; ++format) {
    const std::string path = folder.File("a" + std::to_string(format) + ".cairn");
    MakeMap(path, 3, 4);
    ASSERT_TRUE((*Database::OpenFile(path, Database::Mode::kReadWrite))
                    ->Execute("PRAGMA user_version = " + std::to_string(format))
                    .ok());
    EXPECT_TRUE(IsDamaged(SqliteMapStore::OpenReadOnly(path).status())) << format;
    EXPECT_TRUE(IsDamaged(SqliteMapStore::Open(path).status())) << format;
  }
}

TEST(MapFaults, TruncatedFilesAreDamaged) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn"), broken = folder.File("b.cairn");
  const SnapshotPtr map = MakeMap(path, 5, 5);
  const Bits good(*map);
  const std::string bytes = ReadBytes(path);
  for (std::size_t size = 4096; size < bytes.size(); size += 4096) {
    for (const std::size_t cut : {size, size - 1234}) {
      WriteBytes(broken, bytes.substr(0, cut));
      const Reading reading = ReadAll(broken, good);
      EXPECT_FALSE(reading.loaded);
      EXPECT_TRUE(IsDamaged(reading.status)) << cut << reading.status;
      EXPECT_TRUE(IsDamaged(SqliteMapStore::Open(broken).status()));
    }
  }
}

TEST(MapFaults, KilledWritersLoseNothing) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  MakeMap(path, 6, 3, {.features = 300, .new_points = 60});
  Random random(7);
  for (int trial = 0; trial < 24; ++trial) {
    int pipe_ends[2];
    ASSERT_EQ(pipe(pipe_ends), 0);
    const pid_t child =
        InChild([&] { return WriteForever(path, 100 + static_cast<std::uint64_t>(trial), pipe_ends[1]); });
    close(pipe_ends[1]);
    Revision acknowledged = 0;
    ASSERT_EQ(read(pipe_ends[0], &acknowledged, sizeof(acknowledged)), static_cast<ssize_t>(sizeof(acknowledged)));
    usleep(static_cast<useconds_t>(random.Below(30000)));
    kill(child, SIGKILL);
    while (read(pipe_ends[0], &acknowledged, sizeof(acknowledged)) == sizeof(acknowledged)) {
    }
    close(pipe_ends[0]);
    ASSERT_EQ(ExitCode(child), -1);

    auto file = SqliteMapStore::OpenReadOnly(path);
    ASSERT_TRUE(file.ok()) << file.status();
    const auto map = (*file)->LoadSnapshot();
    ASSERT_TRUE(map.ok()) << map.status();
    EXPECT_GE((*map)->revision(), acknowledged);
    EXPECT_LE((*map)->revision(), acknowledged + 1);
    EXPECT_TRUE((*map)->CheckConsistency().ok());
    if (trial % 8 == 7) {
      EXPECT_THAT(*(*file)->Verify(), IsEmpty());
    }
  }
}

TEST(MapFaults, FullDiskKeepsTheLastRevision) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  MakeMap(path, 8, 3, {.features = 300, .new_points = 60});
  struct stat info {};
  ASSERT_EQ(stat(path.c_str(), &info), 0);
  const auto size = static_cast<rlim_t>(info.st_size);
  const pid_t child = InChild([&] {
    signal(SIGXFSZ, SIG_IGN);
    auto file = SqliteMapStore::Open(path);
    if (!file.ok()) return 2;
    auto map = *(*file)->LoadSnapshot();
    MapGrower grower(9, {.features = 300, .new_points = 60});
    rlimit limit{};
    getrlimit(RLIMIT_FSIZE, &limit);
    const rlim_t no_limit = limit.rlim_cur;
    for (int round = 0; round < 3; ++round) {
      limit.rlim_cur = size + 100000;
      setrlimit(RLIMIT_FSIZE, &limit);
      absl::Status status;
      for (int i = 0; i < 100 && status.ok(); ++i) {
        const map::Delta delta = i % 2 == 0 ? grower.AddKeyframe(map) : grower.Adjust(map, 3);
        status = (*file)->Commit(delta);
        if (status.ok()) map = *map->Apply(delta);
      }
      if (FaultOf(status) != Fault::kFull) return 3;
      if (status.code() != absl::StatusCode::kResourceExhausted) return 4;
      // Reading goes on, and so does writing once there is room.
      auto reader = SqliteMapStore::OpenReadOnly(path);
      if (!reader.ok() || !testing::SameBits(**(*reader)->LoadSnapshot(), *map)) return 5;
      limit.rlim_cur = no_limit;
      setrlimit(RLIMIT_FSIZE, &limit);
      const map::Delta delta = grower.AddKeyframe(map);
      if (!(*file)->Commit(delta).ok()) return 6;
      map = *map->Apply(delta);
    }
    if (!(*file)->Close().ok()) return 7;
    auto reader = SqliteMapStore::OpenReadOnly(path);
    return reader.ok() && testing::SameBits(**(*reader)->LoadSnapshot(), *map) && (*reader)->Verify()->empty() ? 0 : 8;
  });
  EXPECT_EQ(ExitCode(child), 0);
}

TEST(MapFaults, FullDiskAtCreationLeavesTheOldMap) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  const SnapshotPtr map = MakeMap(path, 10, 2);
  const pid_t child = InChild([&] {
    signal(SIGXFSZ, SIG_IGN);
    rlimit limit{};
    getrlimit(RLIMIT_FSIZE, &limit);
    limit.rlim_cur = 50000;
    setrlimit(RLIMIT_FSIZE, &limit);
    const std::string vocabulary(200000, 'v');
    const auto file = SqliteMapStore::Create(path, TestInfo(), {.overwrite = true, .vocabulary = vocabulary});
    return FaultOf(file.status()) == Fault::kFull ? 0 : 1;
  });
  EXPECT_EQ(ExitCode(child), 0);
  EXPECT_THAT(folder.Names(), ElementsAre("a.cairn"));
  EXPECT_TRUE(testing::SameBits(*LoadMap(path), *map));
}

TEST(MapFaults, ReadOnlyMedium) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  const SnapshotPtr map = MakeMap(path, 11, 3);
  chmod(path.c_str(), 0444);
  chmod(folder.path().c_str(), 0555);
  const pid_t child = InChild([&] {
    if (geteuid() == 0 && setuid(65534) != 0) return 1;
    auto reader = SqliteMapStore::OpenReadOnly(path);
    if (!reader.ok()) return 2;
    if (!testing::SameBits(**(*reader)->LoadSnapshot(), *map)) return 3;
    if (!(*reader)->Verify()->empty()) return 4;
    if (FaultOf(SqliteMapStore::Open(path).status()) != Fault::kReadOnly) return 5;
    return FaultOf(SqliteMapStore::Create(path + "2", TestInfo()).status()) == Fault::kReadOnly ? 0 : 6;
  });
  EXPECT_EQ(ExitCode(child), 0);
  chmod(folder.path().c_str(), 0755);
  EXPECT_THAT(folder.Names(), ElementsAre("a.cairn"));
}

TEST(MapFaults, ReadersSeeWholeRevisionsWhileAWriterWorks) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  MakeMap(path, 12, 3, {.features = 300, .new_points = 60});
  int pipe_ends[2];
  ASSERT_EQ(pipe(pipe_ends), 0);
  const pid_t child = InChild([&] { return WriteForever(path, 13, pipe_ends[1]); });
  close(pipe_ends[1]);
  Revision acknowledged = 0;
  ASSERT_EQ(read(pipe_ends[0], &acknowledged, sizeof(acknowledged)), static_cast<ssize_t>(sizeof(acknowledged)));
  EXPECT_EQ(FaultOf(SqliteMapStore::Open(path).status()), Fault::kBusy);
  auto reader = *SqliteMapStore::OpenReadOnly(path);
  Revision last = acknowledged;
  for (int i = 0; i < 25; ++i) {
    if (i % 5 == 4) reader = *SqliteMapStore::OpenReadOnly(path);
    const auto map = reader->LoadSnapshot();
    ASSERT_TRUE(map.ok()) << map.status();
    EXPECT_TRUE((*map)->CheckConsistency().ok());
    EXPECT_GE((*map)->revision(), last);
    last = (*map)->revision();
  }
  EXPECT_GT(last, acknowledged);
  kill(child, SIGKILL);
  ExitCode(child);
  close(pipe_ends[0]);
  reader.reset();
  ASSERT_TRUE((*SqliteMapStore::Open(path))->Close().ok());
  EXPECT_THAT(folder.Names(), ElementsAre("a.cairn"));
}

TEST(MapFaults, ReplacingAMapDoesNotDisturbItsReaders) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  const SnapshotPtr old_map = MakeMap(path, 14, 3);
  auto reader = *SqliteMapStore::OpenReadOnly(path);
  auto file = *SqliteMapStore::Create(path, TestInfo(), {.overwrite = true});
  MapGrower grower(15);
  SnapshotPtr map = map::Snapshot::Empty(TestInfo());
  const auto change = [&](const map::Delta& delta) {
    map = *map->Apply(delta);
    ASSERT_TRUE(file->Commit(delta).ok());
  };
  change(grower.Start(map));
  EXPECT_TRUE(testing::SameBits(**reader->LoadSnapshot(), *old_map));
  change(grower.AddKeyframe(map));
  EXPECT_EQ(FaultOf(reader->ReadRevision().status()), Fault::kMoved);
  EXPECT_EQ(FaultOf(reader->ReadDelta(*old_map).status()), Fault::kMoved);
  reader.reset();  // must not tidy up what belongs to the new map
  change(grower.AddKeyframe(map));
  EXPECT_TRUE(testing::SameBits(*LoadMap(path), *map));
  ASSERT_TRUE(file->Close().ok());
  EXPECT_TRUE(testing::SameBits(*LoadMap(path), *map));
  EXPECT_THAT(folder.Names(), ElementsAre("a.cairn"));
}

}  // namespace
}  // namespace cairn::store

#include "store/recover.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>

#include "map/testing_map.h"
#include "store/sqlite.h"
#include "store/testing_files.h"

namespace cairn::store {
namespace {

using ::testing::Contains;
using testing::ExitCode;
using ::testing::HasSubstr;
using testing::InChild;
using ::testing::IsEmpty;
using testing::LoadMap;
using testing::MakeMap;
using testing::ReadBytes;
using testing::SnapshotPtr;
using testing::TempFolder;
using testing::WriteBytes;
using testing::WriteForever;

constexpr std::size_t kPageBytes = 4096;

class RecoverTest : public ::testing::Test {
 protected:
  // A recovered map is a good one, and what it holds is what there was.
  void ExpectPartOf(const map::Snapshot& original) {
    const auto store = OpenMapStore(good_, OpenMode::kRead);
    ASSERT_TRUE(store.ok()) << store.status();
    EXPECT_THAT(*(*store)->Verify(), IsEmpty());
    const SnapshotPtr map = LoadMap(good_);
    map->keyframes().ForEach([&](const auto& keyframe) {
      const map::Keyframe* was = original.keyframes().Find(keyframe->id);
      ASSERT_NE(was, nullptr);
      EXPECT_EQ(*keyframe->features, *was->features);
      EXPECT_TRUE(keyframe->camera_from_map.translation() == was->camera_from_map.translation());
    });
    map->points().ForEach([&](const auto& point) {
      const map::MapPoint* was = original.points().Find(point->id);
      ASSERT_NE(was, nullptr);
      EXPECT_TRUE(point->position == was->position);
    });
  }

  void Remove(const std::string& path) {
    for (const char* suffix : {"", "-wal", "-shm", "-lock"}) unlink((path + suffix).c_str());
  }

  const TempFolder folder_;
  const std::string bad_ = folder_.File("bad.cairn"), good_ = folder_.File("good.cairn");
};

TEST_F(RecoverTest, OfAGoodMapNothingIsLost) {
  const SnapshotPtr map = MakeMap(bad_, 1, 20);
  const std::string before = ReadBytes(bad_);
  const auto report = RecoverMap(bad_, good_);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->keyframes_lost, 0);
  EXPECT_EQ(report->points_lost, 0);
  EXPECT_THAT(report->findings, IsEmpty());
  EXPECT_THAT(report->notes, IsEmpty());
  EXPECT_TRUE(report->vocabulary);
  EXPECT_EQ(report->revision, map->revision() + 1);
  ExpectPartOf(*map);
  const SnapshotPtr recovered = LoadMap(good_);
  EXPECT_EQ(recovered->keyframes().size(), map->keyframes().size());
  EXPECT_EQ(recovered->points().size(), map->points().size());
  EXPECT_EQ(recovered->info().id, map->info().id);
  // The history is there, and the map can be extended.
  EXPECT_EQ((*OpenMapStore(good_, OpenMode::kRead))->ReadChanges()->size(), map->revision() + 1);
  EXPECT_TRUE(SqliteMapStore::Open(good_).ok());
  EXPECT_EQ(ReadBytes(bad_), before);
  EXPECT_EQ(FaultOf(RecoverMap(bad_, good_).status()), Fault::kExists);
}

TEST_F(RecoverTest, OfMapsOfEarlierFormats) {
  for (const char* name : {"format1.cairn", "format2.cairn", "format3.cairn", "format3_parts.cairn"}) {
    const std::string golden = std::string(GOLDEN_FOLDER) + "/" + name;
    const SnapshotPtr map = LoadMap(golden);
    const auto report = RecoverMap(golden, good_);
    ASSERT_TRUE(report.ok()) << name << report.status();
    EXPECT_EQ(report->keyframes_lost, 0) << name;
    EXPECT_EQ(report->points_lost, 0) << name;
    ExpectPartOf(*map);
    EXPECT_EQ(LoadMap(good_)->LiveComponents(), map->LiveComponents()) << name;
    Remove(good_);
  }
}

TEST_F(RecoverTest, APageThatIsLostCostsWhatWasOnIt) {
  const SnapshotPtr map = MakeMap(bad_, 2, 30, {.features = 300, .new_points = 60});
  const std::string bytes = ReadBytes(bad_);
  const std::size_t pages = bytes.size() / kPageBytes;
  Random random(3);
  std::int64_t kept = 0;
  constexpr int kTrials = 40;
  for (int trial = 0; trial < kTrials; ++trial) {
    std::string damaged = bytes;
    // The first pages hold the schema and the map's own row; the third the camera, which another test is about.
    const std::size_t page = trial < 2 ? static_cast<std::size_t>(trial) : 3 + random.Below(pages - 3);
    for (std::size_t i = 0; i < kPageBytes; ++i) {
      damaged[page * kPageBytes + i] = trial % 2 == 0 ? '\0' : static_cast<char>(random.Below(256));
    }
    WriteBytes(bad_, damaged);
    const auto report = RecoverMap(bad_, good_);
    ASSERT_TRUE(report.ok()) << page << report.status();
    kept += report->keyframes;
    ExpectPartOf(*map);
    Remove(good_);
  }
  // One page of features is one keyframe; one of keyframes' poses, points or lists of points is several.
  EXPECT_GT(static_cast<double>(kept) / (kTrials * 30), 0.93);
}

TEST_F(RecoverTest, ACameraThatIsLostIsFoundFromWhatItSaw) {
  const map::testing::TestMap world = map::testing::MakeMap(9, 8, 300, 0.5);
  const map::Snapshot& made = *world.snapshot;
  map::Delta whole;
  whole.cameras = {made.cameras().begin()->second};
  whole.sessions = {made.sessions().begin()->second};
  whole.components = {made.components().begin()->second};
  made.keyframes().ForEach([&](const auto& keyframe) { whole.keyframes.push_back(keyframe); });
  made.points().ForEach([&](const auto& point) { whole.points.push_back(point); });
  whole.next_keyframe = made.next_keyframe();
  whole.next_point = made.next_point();
  whole.next_camera = made.next_camera();
  whole.next_session = made.next_session();
  whole.next_component = made.next_component();
  {
    auto file = *SqliteMapStore::Create(bad_, world.snapshot->info());
    ASSERT_TRUE(file->Commit(whole).ok());
  }
  std::string damaged = ReadBytes(bad_);
  std::fill_n(damaged.begin() + 2 * kPageBytes, kPageBytes, '\0');
  WriteBytes(bad_, damaged);
  const auto report = RecoverMap(bad_, good_);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->keyframes_lost, 0);
  EXPECT_THAT(report->notes, Contains(HasSubstr("camera 1 is lost")));
  ExpectPartOf(*world.snapshot);
  const Pinhole camera = LoadMap(good_)->pinhole(CameraId(1));
  EXPECT_NEAR(camera.fx_px, map::testing::kPinhole.fx_px, 1.0);
  EXPECT_NEAR(camera.cy_px, map::testing::kPinhole.cy_px, 1.0);
}

TEST_F(RecoverTest, WhatIsBeforeTheEndOfATruncatedFileIsKept) {
  constexpr int kKeyframes = 30;
  const SnapshotPtr map = MakeMap(bad_, 4, kKeyframes, {.features = 300, .new_points = 60});
  const std::string bytes = ReadBytes(bad_);
  int saved = 0;
  for (const double share : {0.98, 0.95, 0.9, 0.7, 0.5, 0.2}) {
    WriteBytes(bad_, bytes.substr(0, static_cast<std::size_t>(share * static_cast<double>(bytes.size()))));
    const auto report = RecoverMap(bad_, good_);
    // Poses of many keyframes are on one page, which may be a late one: then nothing can be saved, and that is said.
    if (!report.ok()) {
      EXPECT_TRUE(IsDamaged(report.status())) << share << report.status();
      continue;
    }
    ++saved;
    EXPECT_LE(report->keyframes, share * kKeyframes + 1);
    EXPECT_GE(report->keyframes, (share - 0.5) * kKeyframes);
    ExpectPartOf(*map);
    Remove(good_);
  }
  EXPECT_GE(saved, 2);
}

TEST_F(RecoverTest, ADamagedHeaderCostsNothing) {
  const SnapshotPtr map = MakeMap(bad_, 5, 10);
  const std::string bytes = ReadBytes(bad_);
  for (const std::size_t at : {0u, 16u, 17u, 20u, 28u, 36u, 56u, 60u, 63u, 68u, 71u}) {
    std::string damaged = bytes;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x08);
    WriteBytes(bad_, damaged);
    const auto report = RecoverMap(bad_, good_);
    ASSERT_TRUE(report.ok()) << at << report.status();
    EXPECT_EQ(report->keyframes_lost, 0) << at;
    EXPECT_EQ(report->points_lost, 0) << at;
    ExpectPartOf(*map);
    Remove(good_);
  }
}

// SQLite goes on from before the damage; what came after it is in the log, and is saved.
TEST_F(RecoverTest, ChangesBehindDamageInTheLogAreKept) {
  MakeMap(bad_, 6, 6);
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const pid_t child = InChild([&] { return WriteForever(bad_, 7, ends[1]); });
  close(ends[1]);
  Revision acknowledged = 0;
  for (int i = 0; i < 12; ++i) {
    ASSERT_EQ(read(ends[0], &acknowledged, sizeof(acknowledged)), static_cast<ssize_t>(sizeof(acknowledged)));
  }
  kill(child, SIGKILL);
  while (read(ends[0], &acknowledged, sizeof(acknowledged)) == sizeof(acknowledged)) {
  }
  close(ends[0]);
  ASSERT_EQ(ExitCode(child), -1);
  const std::string log = bad_ + "-wal";
  std::string damaged = ReadBytes(log);
  const std::size_t frame = 32 + (24 + kPageBytes) * 3;
  damaged[frame + 24 + 2000] = static_cast<char>(damaged[frame + 24 + 2000] ^ 1);
  WriteBytes(log, damaged);
  const auto report = RecoverMap(bad_, good_);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_GT(report->revision, acknowledged);
  EXPECT_LE(report->keyframes_lost, 1);
  EXPECT_THAT(*(*OpenMapStore(good_, OpenMode::kRead))->Verify(), IsEmpty());
  EXPECT_EQ(ReadBytes(log), damaged);
}

TEST_F(RecoverTest, WhatHoldsNothingOfAMapIsRefused) {
  WriteBytes(bad_, "hello");
  EXPECT_TRUE(IsDamaged(RecoverMap(bad_, good_).status()));
  WriteBytes(bad_, std::string(100000, '\x0d'));
  EXPECT_TRUE(IsDamaged(RecoverMap(bad_, good_).status()));
  Random random(8);
  std::string noise(50000, '\0');
  for (char& c : noise) c = static_cast<char>(random.Below(256));
  WriteBytes(bad_, noise);
  EXPECT_TRUE(IsDamaged(RecoverMap(bad_, good_).status()));
  EXPECT_EQ(FaultOf(RecoverMap(folder_.File("none"), good_).status()), Fault::kNotFound);
  EXPECT_FALSE(std::filesystem::exists(good_));
}

}  // namespace
}  // namespace cairn::store

#include "store/sqlite_map_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <limits>

#include "map/lens.h"
#include "store/digest.h"
#include "store/sqlite.h"
#include "store/testing_maps.h"

namespace cairn::store {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::MapGrower;
using testing::SameBits;
using testing::SnapshotPtr;
using testing::TempFolder;
using testing::TestInfo;

std::string Message(const absl::Status& status) { return std::string(status.message()); }

// Applies a change to the map in memory and in the file.
void Change(SqliteMapStore* file, SnapshotPtr* map, const map::Delta& delta) {
  auto next = (*map)->Apply(delta);
  ASSERT_TRUE(next.ok()) << next.status();
  *map = *next;
  const absl::Status status = file->Commit(delta);
  ASSERT_TRUE(status.ok()) << status;
}

// A map with a session and some keyframes, in memory and in the file.
SnapshotPtr Grow(SqliteMapStore* file, MapGrower* grower, int keyframes) {
  SnapshotPtr map = map::Snapshot::Empty(TestInfo());
  Change(file, &map, grower->Start(map));
  for (int i = 0; i < keyframes; ++i) Change(file, &map, grower->AddKeyframe(map));
  return map;
}

void ExpectFileHolds(const std::string& path, const map::Snapshot& map) {
  auto reader = SqliteMapStore::OpenReadOnly(path);
  ASSERT_TRUE(reader.ok()) << reader.status();
  const auto loaded = (*reader)->LoadSnapshot();
  ASSERT_TRUE(loaded.ok()) << loaded.status();
  EXPECT_TRUE(SameBits(**loaded, map));
  EXPECT_EQ(*(*reader)->ReadRevision(), map.revision());
  const auto findings = (*reader)->Verify();
  ASSERT_TRUE(findings.ok()) << findings.status();
  EXPECT_THAT(*findings, IsEmpty()) << findings->front().table << " " << findings->front().message;
}

TEST(SqliteMapStore, EmptyMap) {
  const TempFolder folder;
  auto file = SqliteMapStore::Create(folder.File("a.cairn"), TestInfo(), {.vocabulary = "some words"});
  ASSERT_TRUE(file.ok()) << file.status();
  EXPECT_EQ(*(*file)->ReadRevision(), 0u);
  EXPECT_EQ(*(*file)->LoadVocabulary(), "some words");
  ASSERT_TRUE((*file)->Close().ok());
  EXPECT_THAT(folder.Names(), ElementsAre("a.cairn"));
  const auto reader = *SqliteMapStore::OpenReadOnly(folder.File("a.cairn"));
  EXPECT_TRUE(SameBits(**reader->LoadSnapshot(), *map::Snapshot::Empty(TestInfo())));
}

TEST(SqliteMapStore, RoundTripsToTheBitAfterEveryChange) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  for (const std::uint64_t seed : {1, 2, 3}) {
    auto file = *SqliteMapStore::Create(path, TestInfo(), {.overwrite = true, .vocabulary = "words"});
    MapGrower grower(seed, {.fixed_point_keypoints = seed != 2});
    SnapshotPtr map = Grow(file.get(), &grower, 8);
    ExpectFileHolds(path, *map);
    for (int step = 0; step < 12; ++step) {
      Change(file.get(), &map, grower.AddKeyframe(map));
      Change(file.get(), &map, grower.Adjust(map, 5));
      if (step % 3 == 0) Change(file.get(), &map, grower.Cull(map));
      if (step % 5 == 0) Change(file.get(), &map, grower.Align(map));
      if (step % 4 == 0) ExpectFileHolds(path, *map);
    }
    map::Edit edit(map);
    map::Session session = map->sessions().at(SessionId(1));
    session.complete = true;
    session.ended_unix_ns = 1700000009000000000;
    session.trajectory = map::ReportedTrajectory{seed == 1, 20, 7, "direct: 7 of 20 keyframes \"on a line\""};
    edit.PutSession(session);
    Change(file.get(), &map, edit.Finish("end of the session"));
    ASSERT_TRUE(file->Close().ok());
    EXPECT_THAT(folder.Names(), ElementsAre("a.cairn"));
    ExpectFileHolds(path, *map);
    EXPECT_THAT(folder.Names(), ElementsAre("a.cairn"));
  }
}

TEST(SqliteMapStore, KeepsALensAndTheKeypointsThatItMoved) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  auto file = *SqliteMapStore::Create(path, TestInfo(), {.vocabulary = "words"});
  MapGrower grower(4);
  SnapshotPtr map = Grow(file.get(), &grower, 5);
  map::Edit edit(map);
  map::MapCamera camera = map->cameras().begin()->second;
  camera.lens = LensCorrection{0.9961, 0.0191, -0.0093};
  edit.PutCamera(camera);
  for (const std::uint32_t id : {2u, 4u}) {
    std::vector<image::Keypoint> keypoints = map->keyframe(KeyframeId(id)).keypoints();
    map::CorrectKeypoints(camera, keypoints);
    EXPECT_NE(keypoints, map->keyframe(KeyframeId(id)).keypoints());
    edit.SetKeypoints(KeyframeId(id), std::move(keypoints));
  }
  map::Delta delta = edit.Finish("lens of the camera");
  EXPECT_THAT(delta.moved_keypoints, ElementsAre(KeyframeId(2), KeyframeId(4)));
  const std::string before = ContentDigest(*map);
  Change(file.get(), &map, delta);
  ExpectFileHolds(path, *map);
  EXPECT_NE(ContentDigest(*map), before);
  EXPECT_EQ((*file->LoadSnapshot())->cameras().begin()->second.lens, camera.lens);

  // What claims to have moved must be there.
  map::Edit nothing(map);
  nothing.PutCamera(camera);
  map::Delta wrong = nothing.Finish("nothing moved");
  wrong.moved_keypoints = {KeyframeId(3)};
  EXPECT_EQ(file->Commit(wrong).code(), absl::StatusCode::kInvalidArgument);
  ExpectFileHolds(path, *map);

  camera.lens.reset();
  map::Edit without(map);
  without.PutCamera(camera);
  Change(file.get(), &map, without.Finish("no lens"));
  ExpectFileHolds(path, *map);
}

TEST(SqliteMapStore, LoopsAreKeptInOrder) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  auto file = *SqliteMapStore::Create(path, TestInfo(), {.vocabulary = "words"});
  MapGrower grower(4);
  SnapshotPtr map = Grow(file.get(), &grower, 3);
  for (std::uint32_t i = 0; i < 12; ++i) {
    map::Edit edit(map);
    map::Session session = map->sessions().at(SessionId(1));
    session.loops.push_back({KeyframeId(40 - i), 1403715273262142976 + i, KeyframeId(1 + i), 1403715273262142976,
                             50 + static_cast<int>(i), 1.0 + 0.01 * i, 0.25, -0.0, 60.5});
    edit.PutSession(session);
    Change(file.get(), &map, edit.Finish("close loop"));
    ExpectFileHolds(path, *map);
  }
  EXPECT_EQ((*file->LoadSnapshot())->sessions().at(SessionId(1)).loops, map->sessions().at(SessionId(1)).loops);
}

TEST(SqliteMapStore, ContinuesAfterReopening) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  MapGrower grower(5);
  SnapshotPtr map;
  {
    auto file = *SqliteMapStore::Create(path, TestInfo(), {.vocabulary = "words"});
    map = Grow(file.get(), &grower, 4);
  }
  for (int i = 0; i < 3; ++i) {
    auto file = *SqliteMapStore::Open(path);
    EXPECT_TRUE(SameBits(**file->LoadSnapshot(), *map));
    Change(file.get(), &map, grower.AddKeyframe(map));
    Change(file.get(), &map, grower.Cull(map));
    ASSERT_TRUE(file->Compact().ok());
  }
  ExpectFileHolds(path, *map);
}

TEST(SqliteMapStore, SummaryAndLog) {
  const TempFolder folder;
  auto file = *SqliteMapStore::Create(folder.File("a.cairn"), TestInfo(), {.vocabulary = "12345"});
  MapGrower grower(6);
  const SnapshotPtr map = Grow(file.get(), &grower, 3);
  const MapSummary summary = *file->ReadSummary();
  EXPECT_EQ(summary.format_version, SupportedFormatVersion());
  EXPECT_EQ(summary.revision, 4u);
  EXPECT_EQ(summary.keyframes, 3);
  EXPECT_EQ(summary.points, static_cast<std::int64_t>(map->points().size()));
  EXPECT_EQ(summary.cameras, 1);
  EXPECT_EQ(summary.sessions, 1);
  EXPECT_EQ(summary.vocabulary_bytes, 5);
  EXPECT_EQ(summary.info.name, "office");
  EXPECT_GT(summary.covisibility_edges, 0);
  const std::vector<LoggedChange> changes = *file->ReadChanges({.session = {}, .max_count = 2});
  ASSERT_EQ(changes.size(), 2u);
  EXPECT_EQ(changes[0].revision, 4u);
  EXPECT_EQ(changes[0].reason, "insert keyframe 3");
  EXPECT_EQ(changes[0].points_removed, 0);
  EXPECT_GT(changes[0].committed_unix_ns, 1700000000000000000);
}

TEST(SqliteMapStore, LogIsBounded) {
  const TempFolder folder;
  auto file = *SqliteMapStore::Create(folder.File("a.cairn"), TestInfo(),
                                      {.write = {.sync_every_commit = false, .record_wall_clock = false}});
  SnapshotPtr map = map::Snapshot::Empty(TestInfo());
  for (int i = 0; i < kMaxLoggedChanges + 20; ++i) {
    map::Delta delta;
    delta.base = map->revision();
    delta.reason = "nothing";
    Change(file.get(), &map, delta);
  }
  const std::vector<LoggedChange> changes = *file->ReadChanges();
  EXPECT_EQ(changes.size(), static_cast<std::size_t>(kMaxLoggedChanges));
  EXPECT_EQ(changes.front().revision, map->revision());
  EXPECT_EQ(changes.front().committed_unix_ns, 0);
  EXPECT_EQ((*(*SqliteMapStore::OpenReadOnly(file->uri()))->ReadChanges({.session = {}, .max_count = 5})).size(), 5u);
}

TEST(SqliteMapStore, DigestNamesContentOnly) {
  const TempFolder folder;
  std::vector<std::string> digests;
  for (const std::uint64_t seed : {7, 7, 8}) {
    const std::string path = folder.File(std::to_string(digests.size()));
    map::MapInfo info = TestInfo();
    info.name = path;
    info.created_unix_ns = static_cast<std::int64_t>(digests.size());
    info.id[0] = static_cast<char>('a' + digests.size());
    auto file = *SqliteMapStore::Create(path, info);
    MapGrower grower(seed);
    SnapshotPtr map = map::Snapshot::Empty(info);
    Change(file.get(), &map, grower.Start(map));
    for (int i = 0; i < 3; ++i) Change(file.get(), &map, grower.AddKeyframe(map));
    digests.push_back(*file->ContentDigest());
    EXPECT_EQ(digests.back(), ContentDigest(*map));
    ASSERT_TRUE(file->Compact().ok());
    EXPECT_EQ(*file->ContentDigest(), digests.back());
    Change(file.get(), &map, grower.Adjust(map, 1));
    EXPECT_NE(*file->ContentDigest(), digests.back());
  }
  EXPECT_EQ(digests[0].size(), 32u);
  EXPECT_EQ(digests[0], digests[1]);
  EXPECT_NE(digests[0], digests[2]);
}

TEST(SqliteMapStore, RejectedChangesLeaveTheFileAsItWas) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  auto file = *SqliteMapStore::Create(path, TestInfo(), {.vocabulary = "words"});
  MapGrower grower(9);
  SnapshotPtr map = Grow(file.get(), &grower, 4);
  const map::Delta good = grower.AddKeyframe(map);

  const auto expect_rejected = [&](const map::Delta& delta, absl::StatusCode code) {
    const absl::Status status = file->Commit(delta);
    EXPECT_EQ(status.code(), code) << status;
    EXPECT_EQ(FaultOf(status), Fault::kNone);
    ExpectFileHolds(path, *map);
  };
  map::Delta bad = good;
  bad.base += 1;
  expect_rejected(bad, absl::StatusCode::kFailedPrecondition);
  bad = good;
  bad.removed_points.push_back(PointId(999999));
  expect_rejected(bad, absl::StatusCode::kInvalidArgument);
  bad = good;
  bad.removed_keyframes.push_back(KeyframeId(77));
  expect_rejected(bad, absl::StatusCode::kInvalidArgument);
  bad = good;
  auto lost = std::make_shared<map::MapPoint>(*bad.points.back());
  lost->position.x() = std::numeric_limits<double>::quiet_NaN();
  bad.points.back() = lost;
  expect_rejected(bad, absl::StatusCode::kInvalidArgument);
  bad = good;
  auto orphan = std::make_shared<map::Keyframe>(*bad.keyframes.back());
  orphan->session = SessionId(12);
  bad.keyframes.back() = orphan;
  expect_rejected(bad, absl::StatusCode::kInvalidArgument);
  orphan = std::make_shared<map::Keyframe>(*good.keyframes.back());
  orphan->parent = KeyframeId(1234);
  bad.keyframes.back() = orphan;
  expect_rejected(bad, absl::StatusCode::kInvalidArgument);
  Change(file.get(), &map, good);
  ExpectFileHolds(path, *map);
}

TEST(SqliteMapStore, Vocabulary) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  auto file = *SqliteMapStore::Create(path, TestInfo());
  EXPECT_EQ(file->LoadVocabulary().status().code(), absl::StatusCode::kNotFound);
  std::string vocabulary(4 << 20, '\0');
  Random random(1);
  for (char& c : vocabulary) c = static_cast<char>(random.Next());
  EXPECT_TRUE(file->PutVocabulary("first").ok());
  EXPECT_TRUE(file->PutVocabulary(vocabulary).ok());
  EXPECT_EQ(*file->LoadVocabulary(), vocabulary);
  MapGrower grower(10);
  Grow(file.get(), &grower, 1);
  EXPECT_EQ(file->PutVocabulary("another").code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_TRUE(file->PutVocabulary(vocabulary).ok());
  const auto reader = *SqliteMapStore::OpenReadOnly(path);
  EXPECT_EQ(*reader->LoadVocabulary(), vocabulary);
  EXPECT_EQ(reader->PutVocabulary("x").code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(reader->Commit({}).code(), absl::StatusCode::kFailedPrecondition);
}

TEST(SqliteMapStore, OverwritesOnlyOnRequestAndOnlyWhenReady) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  MapGrower grower(11);
  auto file = *SqliteMapStore::Create(path, TestInfo(), {.vocabulary = "words"});
  const SnapshotPtr map = Grow(file.get(), &grower, 2);
  // While it is written, nobody else replaces or writes it.
  EXPECT_EQ(FaultOf(SqliteMapStore::Create(path, TestInfo(), {.overwrite = true}).status()), Fault::kBusy);
  ASSERT_TRUE(file->Close().ok());

  EXPECT_EQ(FaultOf(SqliteMapStore::Create(path, TestInfo()).status()), Fault::kExists);
  map::MapInfo bad = TestInfo();
  bad.id = "short";
  EXPECT_EQ(SqliteMapStore::Create(path, bad, {.overwrite = true}).status().code(), absl::StatusCode::kInvalidArgument);
  ExpectFileHolds(path, *map);
  const auto replaced = SqliteMapStore::Create(path, TestInfo(), {.overwrite = true});
  ASSERT_TRUE(replaced.ok()) << replaced.status();
  EXPECT_EQ(*(*replaced)->ReadRevision(), 0u);
  EXPECT_EQ(FaultOf(SqliteMapStore::Create(folder.File("none/a.cairn"), TestInfo()).status()), Fault::kNotFound);
  EXPECT_EQ(FaultOf(SqliteMapStore::Create(folder.path(), TestInfo()).status()), Fault::kNotAMap);
}

TEST(SqliteMapStore, OneWriterAtATime) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  auto file = *SqliteMapStore::Create(path, TestInfo());
  const absl::Status second = SqliteMapStore::Open(path).status();
  EXPECT_EQ(FaultOf(second), Fault::kBusy);
  EXPECT_EQ(second.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(Message(second), HasSubstr("is being written by this process already"));
  const std::string link = folder.File("link.cairn");
  ASSERT_EQ(symlink("a.cairn", link.c_str()), 0);
  EXPECT_EQ(FaultOf(SqliteMapStore::Open(link).status()), Fault::kBusy);
  const pid_t child = fork();
  if (child == 0) _exit(FaultOf(SqliteMapStore::Open(path).status()) == Fault::kBusy ? 0 : 1);
  int result = 0;
  waitpid(child, &result, 0);
  EXPECT_EQ(result, 0);
  ASSERT_TRUE(file->Close().ok());
  EXPECT_TRUE(SqliteMapStore::Open(link).ok());
}

TEST(SqliteMapStore, SqlViews) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  auto file = *SqliteMapStore::Create(path, TestInfo(), {.vocabulary = "words"});
  MapGrower grower(12);
  SnapshotPtr map = Grow(file.get(), &grower, 3);
  Change(file.get(), &map, grower.Align(map));
  ASSERT_TRUE(file->Close().ok());

  auto database = *Database::OpenFile(path, Database::Mode::kQueryOnly);
  Statement rows = *database->Prepare(
      "SELECT map_x, map_y, map_z, world_x_m, world_y_m, world_z_m, keyframe FROM keyframe_positions");
  int count = 0;
  while (*rows.Step()) {
    const Vector3d center = map->keyframe(KeyframeId(static_cast<std::uint32_t>(rows.Int(6)))).CenterInMap();
    EXPECT_LT((center - Vector3d(rows.Real(0), rows.Real(1), rows.Real(2))).norm(), 1e-12);
    EXPECT_LT((*map->component(ComponentId(1)).world_from_component * center -
               Vector3d(rows.Real(3), rows.Real(4), rows.Real(5)))
                  .norm(),
              1e-12);
    ++count;
  }
  EXPECT_EQ(count, 3);
  rows = *database->Prepare("SELECT map_x, map_y, map_z, world_x_m, world_y_m, world_z_m, point FROM point_positions");
  while (*rows.Step()) {
    const Vector3d position = map->point(PointId(static_cast<std::uint32_t>(rows.Int(6)))).position;
    EXPECT_EQ(position, Vector3d(rows.Real(0), rows.Real(1), rows.Real(2)));
    EXPECT_LT((*map->component(ComponentId(1)).world_from_component * position -
               Vector3d(rows.Real(3), rows.Real(4), rows.Real(5)))
                  .norm(),
              1e-12);
    ++count;
  }
  EXPECT_EQ(count, 3 + static_cast<int>(map->points().size()));
  EXPECT_EQ(*database->QueryInt("SELECT points FROM session_summary"), static_cast<int>(map->points().size()));
  EXPECT_EQ(*database->QueryInt("SELECT keyframes FROM overview"), 3);
  EXPECT_EQ(*database->QueryInt("SELECT count(*) FROM keyframe_neighbours"),
            2 * (*(*SqliteMapStore::OpenReadOnly(path))->ReadSummary()).covisibility_edges);
}

TEST(SqliteMapStore, SizePerKeyframe) {
  const TempFolder folder;
  const std::string vocabulary(1 << 20, 'v');
  constexpr int kKeyframes = 80;  // what a file has once does not count
  // 1000 features; either keypoints on the grid of 1/32 px, or anywhere with fewer new points.
  for (const bool fixed_point : {true, false}) {
    const std::string path = folder.File(fixed_point ? "fixed" : "float");
    MapGrower grower(13, {.features = 1000,
                          .new_points = fixed_point ? 250 : 130,
                          .views_per_point = 3,
                          .fixed_point_keypoints = fixed_point});
    auto file =
        *SqliteMapStore::Create(path, TestInfo(), {.vocabulary = vocabulary, .write = {.sync_every_commit = false}});
    const SnapshotPtr map = Grow(file.get(), &grower, kKeyframes);
    ASSERT_TRUE(file->Close().ok());
    struct stat info {};
    ASSERT_EQ(stat(path.c_str(), &info), 0);
    const auto bytes = (info.st_size - static_cast<off_t>(vocabulary.size())) / kKeyframes;
    RecordProperty(fixed_point ? "bytes_per_keyframe" : "bytes_per_keyframe_float", static_cast<int>(bytes));
    std::printf("%s keypoints, %.0f points per keyframe: %ld bytes per keyframe\n", fixed_point ? "1/32 px" : "float",
                static_cast<double>(map->points().size()) / kKeyframes, static_cast<long>(bytes));
    EXPECT_LE(bytes, 61000);
  }
}

}  // namespace
}  // namespace cairn::store

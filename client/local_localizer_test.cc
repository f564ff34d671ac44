#include "client/local_localizer.h"

#include <thread>

#include "client/conformance/localizer_conformance.h"
#include "client/map_reader.h"
#include "store/sqlite.h"
#include "store/sqlite_map_store.h"

namespace cairn::conformance {
namespace {

absl::StatusOr<std::unique_ptr<api::Localizer>> OpenLocal(const std::string& path) {
  return client::LocalLocalizer::Open(path);
}

INSTANTIATE_TEST_SUITE_P(Local, LocalizerConformance, testing::Values(LocalizerFactory(&OpenLocal)));

class LocalLocalizer : public testing::Test {
 protected:
  void TearDown() override { std::remove(path_.c_str()); }
  const std::string path_ = testing::TempDir() + "/local_localizer_test_" + std::to_string(getpid()) + ".cairn";
};

TEST_F(LocalLocalizer, RefreshFollowsAWriter) {
  std::remove(path_.c_str());
  const ConformanceMap& map = TheConformanceMap();
  store::CreateOptions options;
  options.vocabulary = map.vocabulary;
  const auto writer = store::SqliteMapStore::Create(path_, map.snapshot->info(), options);
  ASSERT_TRUE(writer.ok()) << writer.status();
  const auto localizer = client::LocalLocalizer::Open(path_);
  ASSERT_TRUE(localizer.ok()) << localizer.status();
  const SE3 truth = LookInRoom({0.2, 0.0, -1.4}, 0.05);
  const api::LocalizeQuery query{map.room.Render(map.pinhole, truth), Camera::FromPinhole(map.pinhole), 0};

  const auto before = (*localizer)->Localize(query);
  ASSERT_TRUE(before.ok());
  EXPECT_EQ(before->stage, api::LocalizeStage::kCandidates) << "the map is still empty";
  EXPECT_FALSE(*(*localizer)->Refresh());

  ASSERT_TRUE((*writer)->Commit(map.delta).ok());
  const auto fresh = (*localizer)->Refresh();
  ASSERT_TRUE(fresh.ok()) << fresh.status();
  EXPECT_TRUE(*fresh);
  const auto after = (*localizer)->Localize(query);
  ASSERT_TRUE(after.ok());
  EXPECT_TRUE(after->localized) << after->reason;
  EXPECT_EQ(after->revision, 1u);
}

// With room for the features of one keyframe every look reads them anew; the answer is the same to the bit.
TEST_F(LocalLocalizer, AnswersTheSameWithLittleMemory) {
  std::remove(path_.c_str());
  ASSERT_TRUE(WriteConformanceMap(path_).ok());
  const ConformanceMap& map = TheConformanceMap();
  const api::LocalizeQuery query{map.room.Render(map.pinhole, LookInRoom({0.2, 0.0, -1.4}, 0.05)),
                                 Camera::FromPinhole(map.pinhole), 0};
  const auto usual = client::LocalLocalizer::Open(path_);
  ASSERT_TRUE(usual.ok()) << usual.status();
  auto reader = client::MapReader::Open(path_, {.feature_budget_bytes = 1});
  ASSERT_TRUE(reader.ok()) << reader.status();
  const auto view = (*reader)->view();
  const auto small = client::LocalLocalizer::Open(*std::move(reader), {});
  ASSERT_TRUE(small.ok()) << small.status();
  for (int i = 0; i < 2; ++i) {
    const auto expected = (*usual)->Localize(query), answer = (*small)->Localize(query);
    ASSERT_TRUE(expected.ok() && answer.ok()) << answer.status();
    EXPECT_TRUE(answer->localized) << answer->reason;
    EXPECT_EQ(answer->world_from_camera.Matrix(), expected->world_from_camera.Matrix());
    EXPECT_EQ(answer->covariance, expected->covariance);
    EXPECT_EQ(answer->counts.inliers, expected->counts.inliers);
  }
  const map::FeatureCache& cache = *view->map().feature_cache();
  EXPECT_EQ(cache.pinned(), 0u) << "somebody looked without holding what he looked at";
  EXPECT_GT(cache.bytes(), 0u);
  EXPECT_LT(cache.bytes(), 500'000u);
}

// From a map that is ready, from one that must be loaded, and from one of whose keyframes and points little is kept.
TEST_F(LocalLocalizer, AnswersTheSameFromReadyPages) {
  std::remove(path_.c_str());
  ASSERT_TRUE(WriteConformanceMap(path_).ok());
  const ConformanceMap& map = TheConformanceMap();
  const api::LocalizeQuery query{map.room.Render(map.pinhole, LookInRoom({0.2, 0.0, -1.4}, 0.05)),
                                 Camera::FromPinhole(map.pinhole), 0};
  const auto ready = client::LocalLocalizer::Open(path_);
  ASSERT_TRUE(ready.ok()) << ready.status();
  ASSERT_NE((*ready)->snapshot().entities(), nullptr) << "the map is not ready";
  auto reader = client::MapReader::Open(path_, {.entity_budget_bytes = 1});
  ASSERT_TRUE(reader.ok()) << reader.status();
  const auto forgetful = client::LocalLocalizer::Open(*std::move(reader), {});
  ASSERT_TRUE(forgetful.ok());
  const auto first = (*ready)->Localize(query);
  ASSERT_TRUE(first.ok() && (*forgetful)->Localize(query).ok());
  EXPECT_GT((*forgetful)->snapshot().entities()->bytes(), 0u);
  ASSERT_TRUE((*forgetful)->Refresh().ok());
  EXPECT_EQ((*forgetful)->snapshot().entities()->bytes(), 0u) << "beyond the budget all is forgotten";
  const auto again = (*forgetful)->Localize(query);
  {
    const auto database = store::Database::OpenFile(path_, store::Database::Mode::kReadWrite);
    ASSERT_TRUE(database.ok());
    ASSERT_TRUE((*database)->Execute("DROP TABLE ready_pages; PRAGMA wal_checkpoint(TRUNCATE)").ok());
  }
  const auto loaded = client::LocalLocalizer::Open(path_);
  ASSERT_TRUE(loaded.ok()) << loaded.status();
  ASSERT_EQ((*loaded)->snapshot().entities(), nullptr);
  const auto expected = (*loaded)->Localize(query);
  ASSERT_TRUE(expected.ok() && again.ok());
  EXPECT_TRUE(expected->localized) << expected->reason;
  for (const auto* answer : {&*first, &*again}) {
    EXPECT_EQ(answer->world_from_camera.Matrix(), expected->world_from_camera.Matrix());
    EXPECT_EQ(answer->covariance, expected->covariance);
    EXPECT_EQ(answer->counts.inliers, expected->counts.inliers);
    EXPECT_EQ(answer->reference_keyframe, expected->reference_keyframe);
  }
}

// What is damaged after the map was opened, or where the disk fails, is no answer but an error; a map that is good
// again answers again.
TEST_F(LocalLocalizer, FeaturesThatCannotBeReadAreAnError) {
  std::remove(path_.c_str());
  ASSERT_TRUE(WriteConformanceMap(path_).ok());
  const ConformanceMap& map = TheConformanceMap();
  const api::LocalizeQuery query{map.room.Render(map.pinhole, LookInRoom({0.2, 0.0, -1.4}, 0.05)),
                                 Camera::FromPinhole(map.pinhole), 0};
  const auto localizer = client::LocalLocalizer::Open(path_);
  ASSERT_TRUE(localizer.ok()) << localizer.status();
  const auto alter = [&](const std::string& sql) {
    const auto database = store::Database::OpenFile(path_, store::Database::Mode::kReadWrite);
    ASSERT_TRUE(database.ok());
    ASSERT_TRUE((*database)->Execute(sql).ok());
    ASSERT_TRUE((*database)->Execute("PRAGMA wal_checkpoint(TRUNCATE)").ok());  // nobody's log is left
  };
  alter("UPDATE keyframe_features SET descriptors_checksum = descriptors_checksum + 1");
  const auto answer = (*localizer)->Localize(query);
  EXPECT_EQ(store::FaultOf(answer.status()), store::Fault::kDamaged);
  EXPECT_THAT(answer.status().message(), testing::HasSubstr("descriptors: wrong checksum"));
  const absl::Status refreshed = (*localizer)->Refresh().status();
  EXPECT_EQ(store::FaultOf(refreshed), store::Fault::kDamaged) << refreshed;
  alter("UPDATE keyframe_features SET descriptors_checksum = descriptors_checksum - 1");
  ASSERT_TRUE((*localizer)->Refresh().ok());
  const auto again = (*localizer)->Localize(query);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_TRUE(again->localized);
}

TEST_F(LocalLocalizer, SeveralThreadsGetTheSameAnswer) {
  std::remove(path_.c_str());
  ASSERT_TRUE(WriteConformanceMap(path_).ok());
  const auto localizer = client::LocalLocalizer::Open(path_);
  ASSERT_TRUE(localizer.ok());
  const ConformanceMap& map = TheConformanceMap();
  const api::LocalizeQuery query{map.room.Render(map.pinhole, LookInRoom({0.2, 0.0, -1.4}, 0.05)),
                                 Camera::FromPinhole(map.pinhole), 0};
  std::vector<absl::StatusOr<api::LocalizeAnswer>> answers(3, absl::UnknownError("not run"));
  std::vector<std::thread> threads;
  for (auto& answer : answers) threads.emplace_back([&] { answer = (*localizer)->Localize(query); });
  for (auto& thread : threads) thread.join();
  for (const auto& answer : answers) {
    ASSERT_TRUE(answer.ok() && answer->localized);
    EXPECT_EQ(answer->map_from_camera.translation(), answers[0]->map_from_camera.translation());
  }
}

TEST_F(LocalLocalizer, ErrorsOfTheFileAndOfOptions) {
  EXPECT_EQ(client::LocalLocalizer::Open(testing::TempDir() + "/no_such_map.cairn").status().code(),
            absl::StatusCode::kNotFound);
  std::remove(path_.c_str());
  map::MapInfo info = TheConformanceMap().snapshot->info();
  info.vocabulary_hash = 0;
  ASSERT_TRUE(store::SqliteMapStore::Create(path_, info).ok());
  const auto without = client::LocalLocalizer::Open(path_).status();
  EXPECT_EQ(without.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(without.message()), testing::HasSubstr("no vocabulary"));
  client::LocalLocalizerOptions options;
  options.num_features = -1;
  EXPECT_EQ(client::LocalLocalizer::Open(path_, options).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace cairn::conformance

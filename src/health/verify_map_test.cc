#include "health/verify_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "health/map_vocabulary.h"
#include "place/default_vocabulary.h"
#include "store/sqlite.h"
#include "store/testing_files.h"

namespace cairn::health {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

// A map whose words come from the vocabulary that ships with Cairn, as most do.
class StoredMap : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto vocabulary = place::LoadDefaultVocabulary();
    ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
    map::MapInfo info = store::testing::TestInfo();
    info.vocabulary_hash = vocabulary->hash();
    auto file = *store::SqliteMapStore::Create(path_, info, {.vocabulary = vocabulary->Serialize()});
    store::testing::MapGrower grower(7);
    auto map = map::Snapshot::Empty(info);
    for (int i = 0; i < 5; ++i) {
      map::Delta delta = i == 0 ? grower.Start(map) : grower.AddKeyframe(map);
      for (auto& keyframe : delta.keyframes) {
        if (map->keyframes().Contains(keyframe->id)) continue;
        auto features = std::make_shared<map::KeyframeFeatures>(*keyframe->features);
        features->words = vocabulary->LookupAll(features->features.descriptors);
        auto changed = std::make_shared<map::Keyframe>(*keyframe);
        changed->features = std::move(features);
        keyframe = std::move(changed);
      }
      map = *map->Apply(delta);
      ASSERT_TRUE(file->Commit(delta).ok());
    }
    ASSERT_TRUE(file->Close().ok());
  }

  void Execute(const std::string& sql) {
    auto database = *store::Database::OpenFile(path_, store::Database::Mode::kReadWrite);
    const absl::Status status = database->Execute("PRAGMA foreign_keys = OFF; " + sql);
    ASSERT_TRUE(status.ok()) << status;
  }

  const store::testing::TempFolder folder_;
  const std::string path_ = folder_.File("a.cairn");
};

TEST_F(StoredMap, DamageToTheShippedVocabularyCostsNothing) {
  for (const char* damage : {"UPDATE vocabulary SET bytes = 'x' || substr(bytes, 2)", "DELETE FROM vocabulary"}) {
    Execute(damage);
    const auto store = store::OpenMapStore(path_, store::OpenMode::kRead);
    ASSERT_TRUE(store.ok()) << store.status();
    const auto vocabulary = LoadVocabulary(**store);
    ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
    ASSERT_NE(vocabulary->words, nullptr);
    EXPECT_EQ(vocabulary->words->hash(), place::LoadDefaultVocabulary()->hash());
    EXPECT_THAT(vocabulary->note, HasSubstr("ships with Cairn"));
    const auto report = VerifyMap(path_);
    ASSERT_TRUE(report.ok()) << report.status();
    ASSERT_THAT(report->findings, SizeIs(1));
    EXPECT_EQ(report->findings[0].table, "vocabulary");
  }
}

TEST_F(StoredMap, AnotherVocabularyIsNotMadeUp) {
  Execute("UPDATE vocabulary SET bytes = 'x'; UPDATE map SET vocabulary_hash = '0000000000000001'");
  const auto store = store::OpenMapStore(path_, store::OpenMode::kRead);
  EXPECT_FALSE(store.ok() && LoadVocabulary(**store).ok());
}

TEST_F(StoredMap, AGoodMapHasNoFindings) {
  const auto report = VerifyMap(path_);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_THAT(report->findings, IsEmpty());
  ASSERT_TRUE(report->summary);
  EXPECT_EQ(report->summary->keyframes, 4);
}

// The maps of the store's tests have random keypoints: their structure is right, and what they say is not.
TEST_F(StoredMap, ADeepCheckFindsWhatMakesNoSense) {
  const auto report = VerifyMap(path_, {.deep = true});
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->checked_words, 4 * 60);
  ASSERT_FALSE(report->findings.empty());
  for (const store::Finding& finding : report->findings) EXPECT_EQ(finding.table, "keyframes") << finding.message;
}

TEST_F(StoredMap, AFileThatCannotBeOpenedIsAFinding) {
  Execute("DROP TABLE points");
  const auto report = VerifyMap(path_);
  ASSERT_TRUE(report.ok()) << report.status();
  ASSERT_THAT(report->findings, SizeIs(1));
  EXPECT_THAT(report->findings[0].message, HasSubstr("points"));
  EXPECT_FALSE(VerifyMap(folder_.File("none.cairn")).ok());
}

}  // namespace
}  // namespace cairn::health

#include "store/ready_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "place/index.h"
#include "place/vocabulary.h"
#include "store/digest.h"
#include "store/ready_summary.h"
#include "store/ready_writer.h"
#include "store/row.h"
#include "store/sqlite_map_store.h"
#include "store/table_spec.h"
#include "store/testing_maps.h"

namespace cairn::store {
namespace {

using ::testing::Contains;
using testing::GrowOptions;
using ::testing::HasSubstr;
using testing::MapGrower;
using testing::SameBits;
using testing::SnapshotPtr;
using testing::TempFolder;

constexpr std::uint32_t kNumWords = 200;

place::Vocabulary Words() {
  std::vector<place::Vocabulary::Node> nodes(1 + kNumWords);
  for (std::uint32_t i = 1; i <= kNumWords; ++i) {
    nodes[i].descriptor = {i, 2 * i, 3 * i, 4 * i};
    nodes[i].weight = i % 10 == 0 ? 0.0f : 0.5f + static_cast<float>(i % 7);
  }
  return *place::Vocabulary::FromNodes(nodes, 255, 1);
}

// What LoadReady() gives, brought to the newest revision.
struct Loaded {
  SnapshotPtr ready, newest;
  std::shared_ptr<place::InvertedIndex> places;
  std::size_t segments = 0;
};

class ReadyMapTest : public ::testing::Test {
 protected:
  ReadyMapTest() : words_(Words()) {
    info_ = testing::TestInfo();
    info_.vocabulary_hash = words_.hash();
  }

  // Closed, with so many keyframes.
  SnapshotPtr Make(int keyframes, GrowOptions options = {}) {
    options.num_words = kNumWords;
    grower_ = std::make_unique<MapGrower>(7, options);
    auto store = *SqliteMapStore::Create(path_, info_,
                                         {.vocabulary = words_.Serialize(), .write = {.sync_every_commit = false}});
    SnapshotPtr map = map::Snapshot::Empty(info_);
    Commit(store.get(), &map, grower_->Start(map));
    for (int i = 0; i < keyframes; ++i) Commit(store.get(), &map, grower_->AddKeyframe(map));
    EXPECT_TRUE(store->Close().ok());
    return map;
  }

  static void Commit(MapStore* store, SnapshotPtr* map, const map::Delta& delta) {
    const auto next = (*map)->Apply(delta);
    ASSERT_TRUE(next.ok()) << next.status();
    const absl::Status committed = store->Commit(delta);
    ASSERT_TRUE(committed.ok()) << committed;
    *map = *next;
  }

  std::optional<Loaded> Load() {
    auto store = *SqliteMapStore::OpenReadOnly(path_);
    Loaded loaded;
    std::vector<float> idf;
    for (place::WordId word = 0; word < words_.num_words(); ++word) idf.push_back(words_.weight(word));
    loaded.places = std::make_shared<place::InvertedIndex>(idf);
    ReadyOptions options;
    options.feature_budget_bytes = 1'000'000;
    options.segment = [&](std::span<const KeyframeId> keyframes, SharedBytes packed) -> absl::Status {
      CAIRN_ASSIGN_OR_RETURN(auto segment,
                             place::PostingSegment::Unpack(loaded.places->num_entries(), kNumWords, std::move(packed)));
      std::vector<std::uint32_t> ids;
      for (const KeyframeId id : keyframes) ids.push_back(id.value());
      ++loaded.segments;
      return loaded.places->AddSegment(ids, std::move(segment));
    };
    const auto ready = store->LoadReady(options);
    EXPECT_TRUE(ready.ok()) << ready.status();
    if (!ready.ok() || !*ready) return std::nullopt;
    loaded.ready = loaded.newest = (*ready)->map;
    if ((*ready)->since) {
      const auto newest = loaded.ready->Apply(*(*ready)->since);
      EXPECT_TRUE(newest.ok()) << newest.status();
      if (newest.ok()) loaded.newest = *newest;
    }
    return loaded;
  }

  std::vector<std::string> Verified() {
    const auto findings = (*SqliteMapStore::OpenReadOnly(path_))->Verify();
    EXPECT_TRUE(findings.ok()) << findings.status();
    std::vector<std::string> told;
    for (const Finding& finding : *findings) told.push_back(absl::StrCat(finding.table, ": ", finding.message));
    return told;
  }

  // That the file is good, and its ready pages say what the tables say.
  void ExpectGood() {
    const auto findings = (*SqliteMapStore::OpenReadOnly(path_))->Verify();
    ASSERT_TRUE(findings.ok()) << findings.status();
    for (const Finding& finding : *findings)
      ADD_FAILURE() << finding.table << " " << finding.id << " " << finding.message;
  }

  void ExpectPlaces(const Loaded& loaded) {
    place::InvertedIndex expected(std::vector<float>(loaded.places->idf().begin(), loaded.places->idf().end()));
    loaded.ready->keyframes().ForEach([&](const auto& keyframe) {
      const auto bow = place::Weigh(keyframe->features.Get()->words, expected.idf());
      ASSERT_TRUE(expected.Add(keyframe->id.value(), bow).ok());
    });
    place::QueryOptions five;
    five.max_results = 5;
    const place::InvertedIndex::Counts counts = [](std::uint32_t id, std::uint32_t) { return id != 0; };
    loaded.ready->keyframes().ForEach([&](const auto& keyframe) {
      const auto bow = place::Weigh(keyframe->features.Get()->words, expected.idf());
      EXPECT_EQ(loaded.places->Query(bow, five, counts), expected.Query(bow, five));
    });
  }

  void Alter(const std::string& sql) {
    const auto database = Database::OpenFile(path_, Database::Mode::kReadWrite);
    ASSERT_TRUE(database.ok());
    const absl::Status altered = (*database)->Execute(sql);
    ASSERT_TRUE(altered.ok()) << altered;
    ASSERT_TRUE((*database)->Execute("PRAGMA wal_checkpoint(TRUNCATE)").ok());
  }

  const TempFolder folder_;
  const std::string path_ = folder_.File("a.cairn");
  const place::Vocabulary words_;
  map::MapInfo info_;
  std::unique_ptr<MapGrower> grower_;
};

TEST_F(ReadyMapTest, SaysToTheBitWhatTheTablesSay) {
  const SnapshotPtr map = Make(60);
  const auto loaded = Load();
  ASSERT_TRUE(loaded);
  EXPECT_EQ(loaded->ready->revision(), map->revision());
  EXPECT_EQ(loaded->ready->entities()->bytes(), 0u) << "nothing was looked at yet";
  EXPECT_EQ(loaded->ready->NumKeyframes(ComponentId(1)), 60);
  EXPECT_TRUE(SameBits(*loaded->newest, *map));
  EXPECT_GT(loaded->ready->entities()->bytes(), 0u);
  EXPECT_TRUE(loaded->newest->CheckConsistency().ok());
  EXPECT_TRUE(SameBits(*loaded->newest->Anew(), *map));
  ExpectPlaces(*loaded);
  ExpectGood();
}

TEST_F(ReadyMapTest, TheSummaryMissesRowsOfSmallTables) {
  const SnapshotPtr map = Make(30);
  const auto shares = [&]() -> std::vector<map::KeyframeShare> {
    const auto database = *Database::OpenFile(path_, Database::Mode::kReadOnly);
    const auto summary = ReadReadySummary(database.get(), map->revision());
    if (!summary) return {};
    const auto counted = *CountShares(database.get(), kNewestFormat);
    EXPECT_EQ(PackReadySummary({counted, summary->rows}), PackReadySummary(*summary));
    EXPECT_EQ(PackReadySummary(*Summarize(database.get())), PackReadySummary(*summary));
    return summary->shares;
  };
  ASSERT_EQ(shares().size(), 1u);
  EXPECT_EQ(shares()[0].keyframes, 30);
  ExpectGood();
  Alter("DELETE FROM touched WHERE revision = 3");
  EXPECT_THAT(Verified(), Contains(HasSubstr("touched: there are")));
  const auto store = *SqliteMapStore::OpenReadOnly(path_);
  EXPECT_TRUE(IsDamaged(store->ReadChangedRows(2).status()));
  EXPECT_TRUE(store->LoadSnapshot().ok()) << "of what was changed when, it says nothing";
}

TEST_F(ReadyMapTest, RowsThatDescribeTheMapAreMissedByWhoOpensIt) {
  Make(30);
  Alter("PRAGMA foreign_keys = OFF; DELETE FROM sessions");
  EXPECT_THAT(Verified(), Contains(HasSubstr("sessions: there are 0 rows instead of")));
  EXPECT_FALSE(Load());
}

TEST_F(ReadyMapTest, IsGoneThroughWithoutBeingKept) {
  const SnapshotPtr map = Make(60);
  const auto loaded = Load();
  ASSERT_TRUE(loaded);
  const map::Snapshot& ready = *loaded->ready;
  std::vector<KeyframeId> seen;
  std::set<const map::Snapshot*> around;
  map::ForEachKeyframe(ready, /*budget_bytes=*/20000, [&](const map::Snapshot& at, const map::Keyframe& keyframe) {
    seen.push_back(keyframe.id);
    around.insert(&at);
    for (const PointId point : keyframe.points) {
      EXPECT_TRUE(!point || at.point(point).position == map->point(point).position);
    }
    EXPECT_EQ(&at.keyframe(keyframe.id), &keyframe);
  });
  std::vector<KeyframeId> all;
  map->keyframes().ForEach([&](const auto& keyframe) { all.push_back(keyframe->id); });
  EXPECT_EQ(seen, all);
  EXPECT_FALSE(around.contains(&ready));
  EXPECT_EQ(ready.entities()->bytes(), 0u) << "what was looked at is kept";
}

TEST_F(ReadyMapTest, AWriterThatCloses) {
  SnapshotPtr map = Make(40);
  for (int round = 0; round < 6; ++round) {
    auto store = *SqliteMapStore::Open(path_, {.sync_every_commit = false});
    for (int i = 0; i < 3 + round; ++i) Commit(store.get(), &map, grower_->AddKeyframe(map));
    Commit(store.get(), &map, grower_->Adjust(map, 5));
    for (int i = 0; i < 2 * round; ++i) Commit(store.get(), &map, grower_->Cull(map));
    if (round == 3) Commit(store.get(), &map, grower_->Align(map));
    // While it writes, readers go on from what was ready before.
    const auto meanwhile = Load();
    ASSERT_TRUE(meanwhile);
    EXPECT_LT(meanwhile->ready->revision(), map->revision());
    EXPECT_TRUE(SameBits(*meanwhile->newest, *map)) << "round " << round;
    ASSERT_TRUE(store->Close().ok());
    const auto loaded = Load();
    ASSERT_TRUE(loaded);
    EXPECT_EQ(loaded->ready->revision(), map->revision()) << "round " << round;
    EXPECT_TRUE(SameBits(*loaded->newest, *map)) << "round " << round;
    EXPECT_EQ(ContentDigest(*loaded->newest), ContentDigest(*map));
    ExpectPlaces(*loaded);
    ExpectGood();
  }
}

// A view that was made before goes on as long as the pages that it looks at are as they were, and is told else.
TEST_F(ReadyMapTest, AViewFromBeforeIsToldOfPagesThatAreNewer) {
  SnapshotPtr map = Make(60);
  const auto before = Load();
  ASSERT_TRUE(before);
  auto store = *SqliteMapStore::Open(path_, {.sync_every_commit = false});
  Commit(store.get(), &map, grower_->Adjust(map, 3));
  ASSERT_TRUE(store->Close().ok());
  const map::Keyframe& old = before->ready->keyframe(KeyframeId(2));
  EXPECT_EQ(old.camera_from_direct.Matrix(), map->keyframe(KeyframeId(2)).camera_from_direct.Matrix());
  EXPECT_TRUE(before->ready->feature_cache()->status().ok());
  EXPECT_NE(before->ready->keyframes().Find(KeyframeId(60)), nullptr) << "something stands in for it";
  const absl::Status told = before->ready->feature_cache()->status();
  EXPECT_EQ(FaultOf(told), Fault::kBusy) << told;
}

TEST_F(ReadyMapTest, ADamagedPageIsReadFromTheTables) {
  const SnapshotPtr map = Make(60);
  for (const auto& [kind, number] : {std::pair(ReadyKind::kKeyframes, 1u), std::pair(ReadyKind::kPoints, 1u)}) {
    const std::string where = absl::StrCat(" WHERE id = ", ReadyRowId(kind, number));
    Alter(absl::StrCat("UPDATE ready_pages SET bytes_checksum = bytes_checksum + 1", where));
    const auto loaded = Load();
    ASSERT_TRUE(loaded) << "it is not looked at until then";
    EXPECT_TRUE(SameBits(*loaded->newest, *map));
    EXPECT_TRUE(loaded->ready->feature_cache()->status().ok());
    const auto findings = (*SqliteMapStore::OpenReadOnly(path_))->Verify();
    ASSERT_TRUE(findings.ok());
    ASSERT_FALSE(findings->empty());
    EXPECT_EQ(findings->front().table, "ready_pages");
    EXPECT_EQ(findings->front().id, ReadyRowId(kind, number));
    Alter(absl::StrCat("UPDATE ready_pages SET bytes_checksum = bytes_checksum - 1", where));
  }
  ExpectGood();
}

TEST_F(ReadyMapTest, IsNotReadyWithADamagedIndexOrPlaces) {
  Make(20);
  ASSERT_TRUE(Load());
  for (const char* damage : {"UPDATE ready_pages SET bytes_checksum = bytes_checksum + 1 WHERE id = 0",
                             "UPDATE ready_pages SET revision = revision + 1 WHERE id >> 32 = 3",
                             "DELETE FROM ready_pages WHERE id = 0", "DROP TABLE ready_pages"}) {
    Alter(damage);
    EXPECT_FALSE(Load()) << damage;
    EXPECT_TRUE((*SqliteMapStore::OpenReadOnly(path_))->LoadSnapshot().ok());
  }
  // Who writes next makes it ready again.
  SnapshotPtr map = *(*SqliteMapStore::OpenReadOnly(path_))->LoadSnapshot();
  auto store = *SqliteMapStore::Open(path_, {.sync_every_commit = false});
  ASSERT_TRUE(store->Close().ok());
  const auto loaded = Load();
  ASSERT_TRUE(loaded);
  EXPECT_TRUE(SameBits(*loaded->newest, *map));
}

TEST_F(ReadyMapTest, IsNotKeptReadyIfNobodyWantsThat) {
  grower_ = std::make_unique<MapGrower>(7, GrowOptions{.num_words = kNumWords});
  auto store =
      *SqliteMapStore::Create(path_, info_,
                              {.vocabulary = words_.Serialize(),
                               .write = {.sync_every_commit = false, .record_wall_clock = true, .ready = false}});
  SnapshotPtr map = map::Snapshot::Empty(info_);
  Commit(store.get(), &map, grower_->Start(map));
  Commit(store.get(), &map, grower_->AddKeyframe(map));
  ASSERT_TRUE(store->Close().ok());
  EXPECT_FALSE(Load());
  ExpectGood();
}

TEST_F(ReadyMapTest, VerifyFindsWhatTheTablesDoNotSay) {
  const SnapshotPtr map = Make(20);
  // A page with a good checksum that says something else.
  auto database = *Database::OpenFile(path_, Database::Mode::kReadWrite);
  const auto points = PointsOfPage(*map, 0);
  map::MapPoint moved = *points[3];
  moved.position.x() += 1e-9;
  std::vector<const map::MapPoint*> others = points;
  others[3] = &moved;
  const std::string bytes = SealReadyPage(ReadyRowId(ReadyKind::kPoints, 0), map->revision(), PackReadyPoints(others));
  {
    Statement put = *database->Prepare("UPDATE ready_pages SET bytes = ?1, bytes_checksum = ?2 WHERE id = ?3");
    put.Bind(1, AsBytes(bytes));
    put.Bind(2, BlobChecksum(AsBytes(bytes)));
    put.Bind(3, ReadyRowId(ReadyKind::kPoints, 0));
    ASSERT_TRUE(put.Run().ok());
  }
  ASSERT_TRUE(database->Close().ok());
  const auto findings = (*SqliteMapStore::OpenReadOnly(path_))->Verify();
  ASSERT_TRUE(findings.ok());
  ASSERT_EQ(findings->size(), 1u);
  EXPECT_THAT((*findings)[0].message, HasSubstr("does not say what the tables say"));
}

// Whatever a byte of a page becomes, nothing leads out of the map (which a sanitizer sees).
TEST(ReadyPages, DamagedContentIsRefusedOrHarmless) {
  MapGrower grower(3, {.features = 30, .num_words = kNumWords});
  SnapshotPtr map = map::Snapshot::Empty(testing::TestInfo());
  map = *map->Apply(grower.Start(map));
  for (int i = 0; i < 12; ++i) map = *map->Apply(grower.AddKeyframe(map));
  const ReadyIndex index = **IndexOf(*map);
  const std::string pages[] = {index.Pack(), PackReadyKeyframes(KeyframesOfPage(*map, 0)),
                               PackReadyPoints(PointsOfPage(*map, 0))};
  ASSERT_TRUE(ReadyIndex::Unpack(AsBytes(pages[0])).ok());
  Random random(5);
  for (int which = 0; which < 3; ++which) {
    for (std::size_t i = 0; i < pages[which].size(); ++i) {
      std::string changed = pages[which];
      changed[i] = static_cast<char>(random.Below(256));
      if (i % 3 == 0) changed.resize(i);
      if (which == 0) ReadyIndex::Unpack(AsBytes(changed)).IgnoreError();
      const auto ends = FindReadyKeyframes(0, index, AsBytes(changed));
      for (std::uint32_t id = 1; ends.ok() && id < kKeyframesPerPage; ++id) {
        ASSERT_LE((*ends)[id], (*ends)[id + 1]);
        ASSERT_LE((*ends)[id + 1], changed.size());
        const ReadyKeyframe* known = index.Find(KeyframeId(id));
        if (known == nullptr) continue;
        const auto keyframe =
            UnpackReadyKeyframe(index, *known, AsBytes(changed).subspan((*ends)[id], (*ends)[id + 1] - (*ends)[id]));
        if (!keyframe.ok()) continue;
        for (const PointId point : (*keyframe)->points) EXPECT_TRUE(!point || index.HasPoint(point));
        for (const map::CovisibilityEdge& edge : (*keyframe)->covisible) {
          EXPECT_NE(index.Find(edge.keyframe), nullptr);
        }
      }
      std::vector<map::MapPoint> points;
      if (!UnpackReadyPoints(0, index, AsBytes(changed), &points).ok()) continue;
      for (const map::MapPoint& point : points) {
        ASSERT_FALSE(point.observations.empty());
        for (const map::Observation& observation : point.observations) {
          const ReadyKeyframe* keyframe = index.Find(observation.keyframe);
          ASSERT_NE(keyframe, nullptr);
          EXPECT_LT(observation.feature, keyframe->num_features);
        }
      }
    }
  }
}

}  // namespace
}  // namespace cairn::store

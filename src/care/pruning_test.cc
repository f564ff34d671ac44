#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "care/pruning_trial.h"
#include "care/testing_room.h"
#include "care/whole_map.h"
#include "store/testing_maps.h"

namespace cairn::care {
namespace {

using testing::Room;

class PruningTest : public ::testing::Test {
 protected:
  // Each place is stood at four times.
  PruningTest() {
    std::vector<SE3> poses;
    for (const SE3& pose : tracking::testing_world::PathInRoom(Vector3d::Zero(), 10)) {
      for (int i = 0; i < 4; ++i) {
        poses.push_back(SE3(Quaterniond::Identity(), Vector3d(0.01 * i, 0.0, 0.0)) * pose);
      }
    }
    map_ = room_.Map(poses, 3);
    EXPECT_TRUE(Write(*map_, "room.cairn").ok());
    overview_ = *store::ReadMapOverview(folder_.File("room.cairn"));
  }
  absl::Status Write(const map::Snapshot& map, const std::string& name) {
    return WriteNewMap(map, map_->info(), room_.words->Serialize(), folder_.File(name), true, "made");
  }

  const store::testing::TempFolder folder_;
  const Room room_{5};
  std::shared_ptr<const map::Snapshot> map_;
  store::MapOverview overview_;
};

TEST_F(PruningTest, WhatOthersShowGoesAndTheMapIsAsGood) {
  const auto plan = PlanPruning(map_, overview_, {});
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_GE(plan->keyframes, 10);
  EXPECT_LE(plan->keyframes, 34);
  EXPECT_EQ(plan->keyframes + plan->keyframes_left, 40);
  const auto after = map_->Apply(plan->delta);
  ASSERT_TRUE(after.ok()) << after.status();
  ASSERT_TRUE((*after)->CheckConsistency().ok());
  inspect::CoverageOptions coverage;
  coverage.max_tests = 5;
  const auto queries = CompareSelfQueries(*room_.View(map_), *room_.View(*after), coverage);
  ASSERT_TRUE(queries.ok()) << queries.status();
  EXPECT_GE(queries->whole.views, 4);
  EXPECT_GE(queries->whole.found_after, queries->whole.found_before - 1);
  EXPECT_EQ(queries->halves.views, 4 * queries->whole.views);
}

// What is lost shows where views show less, before whole ones get lost.
TEST_F(PruningTest, WhatIsLostShowsInHalvesFirst) {
  map::Edit edit(map_);
  // Nine points of ten go: a map that is hardly good for anything.
  map_->points().ForEach([&](const auto& point) {
    if (point->id.value() % 10 != 0) edit.ErasePoint(point->id);
  });
  const auto thin = map_->Apply(edit.Finish("thinned"));
  ASSERT_TRUE(thin.ok()) << thin.status();
  inspect::CoverageOptions coverage;
  coverage.max_tests = 4;
  const auto queries = CompareSelfQueries(*room_.View(map_), *room_.View(*thin), coverage);
  ASSERT_TRUE(queries.ok()) << queries.status();
  EXPECT_GT(queries->halves.loss(), 0.3);
  EXPECT_GE(queries->halves.loss(), queries->whole.loss());
  EXPECT_GE(queries->halves.LossAtMost(), queries->halves.loss());
}

TEST(QueryCount, WhatMayBeLostShrinksWithWhatWasAsked) {
  EXPECT_EQ(QueryCount().LossAtMost(), 1.0);
  // By the interval's formula: z^2 / (n + z^2) if nothing is lost.
  EXPECT_NEAR((QueryCount{26, 26, 26, 0}).LossAtMost(), 2.706 / 28.706, 1e-3);
  EXPECT_NEAR((QueryCount{1000, 1000, 900, 100}).LossAtMost(), 0.1168, 1e-3);
  EXPECT_NEAR((QueryCount{5, 5, 0, 5}).LossAtMost(), 1.0, 1e-9);
}

TEST_F(PruningTest, ABudgetIsKeptAndPredicted) {
  const std::int64_t fixed = overview_.summary.vocabulary_bytes;
  PruneOptions options;
  options.budget_bytes = fixed + (overview_.summary.file_bytes - fixed) / 2;
  const auto plan = PlanPruning(map_, overview_, options);
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_LE(plan->bytes_after, *options.budget_bytes);
  const auto after = *map_->Apply(plan->delta);
  ASSERT_TRUE(Write(*after, "half.cairn").ok());
  const auto written = *store::ReadMapOverview(folder_.File("half.cairn"));
  EXPECT_NEAR(static_cast<double>(written.summary.file_bytes), static_cast<double>(plan->bytes_after),
              0.06 * static_cast<double>(plan->bytes_after));
  // Still from every place, as evenly as it goes.
  std::vector<bool> stood(10);
  after->keyframes().ForEach([&](const auto& keyframe) { stood[(keyframe->id.value() - 1) / 4] = true; });
  EXPECT_GE(std::ranges::count(stood, true), 9);
}

TEST_F(PruningTest, WhatIsTriedIsWhatTheFileHas) {
  const std::string path = folder_.File("room.cairn");
  const std::int64_t all = overview_.summary.file_bytes;
  for (const double share : {1.0, 0.9, 0.8, 0.7}) {
    PruneOptions options;
    const auto budget = static_cast<std::int64_t>(share * static_cast<double>(all));
    options.budget_bytes = budget;
    const auto plan = TryPruning(path, map_, options);
    ASSERT_TRUE(plan.ok()) << plan.status();
    EXPECT_LE(plan->bytes_after, budget);
    const std::string copy = folder_.File(absl::StrCat("pruned", share, ".cairn"));
    ASSERT_TRUE((*store::OpenMapStore(path, store::OpenMode::kRead))->CopyTo(copy).ok());
    auto store = *store::OpenMapStore(copy, store::OpenMode::kWrite);
    const absl::Status committed = plan->delta.empty() ? absl::OkStatus() : store->Commit(plan->delta);
    ASSERT_TRUE(committed.ok()) << committed;
    ASSERT_TRUE(store->Close().ok());
    store = *store::OpenMapStore(copy, store::OpenMode::kWrite);
    ASSERT_TRUE(store->Compact().ok());
    EXPECT_EQ(store->ReadSummary()->file_bytes, plan->bytes_after);
    ASSERT_TRUE(store->Close().ok());
  }
  EXPECT_THAT(folder_.Names(), ::testing::Not(::testing::Contains(::testing::HasSubstr("trial"))));
  PruneOptions options;
  options.budget_bytes = 1000;
  EXPECT_TRUE(absl::IsFailedPrecondition(TryPruning(path, map_, options).status()));
  EXPECT_EQ(store::ReadMapOverview(path)->summary.revision, overview_.summary.revision) << "it is as it was";
}

TEST_F(PruningTest, WhatCannotBeKeptIsSaid) {
  PruneOptions options;
  options.budget_bytes = 1000;
  const absl::Status status = PlanPruning(map_, overview_, options).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(status));
  EXPECT_THAT(std::string(status.message()), ::testing::HasSubstr("MB"));
  options.budget_bytes = overview_.summary.file_bytes * 10;
  EXPECT_TRUE(PlanPruning(map_, overview_, options)->delta.empty()) << "it is in the budget as it is";
  options.budget_bytes = 0;
  EXPECT_TRUE(absl::IsInvalidArgument(PlanPruning(map_, overview_, options).status()));
}

}  // namespace
}  // namespace cairn::care

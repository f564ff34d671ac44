// Every call by which a verb that keeps maps changes a file fails once: the map is as it was or as it should be.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "care/pruning.h"
#include "care/testing_room.h"
#include "care/whole_map.h"
#include "engine/live_map.h"
#include "store/digest.h"
#include "store/testing_failing_vfs.h"
#include "store/testing_files.h"

namespace cairn::care {
namespace {

using store::testing::FailingVfs;
using store::testing::TempFolder;

class CareFaultTest : public ::testing::Test {
 protected:
  CareFaultTest() {
    EXPECT_TRUE(WriteNewMap(*map_, map_->info(), room_.words->Serialize(), original_, false, "made").ok());
    before_ = Digest(original_);
  }
  static std::string Digest(const std::string& path) {
    const auto store = store::OpenMapStore(path, store::OpenMode::kRead);
    EXPECT_TRUE(store.ok()) << store.status();
    if (!store.ok()) return "";
    EXPECT_THAT(*(*store)->Verify(), ::testing::IsEmpty());
    return *(*store)->ContentDigest();
  }
  // Calls `change` with the n-th call failing, for every n, and `check` afterwards; ends with the one that has none.
  void EachCall(const std::function<absl::Status()>& change, const std::function<void(const absl::Status&)>& check) {
    for (int n = 1;; ++n) {
      ASSERT_LT(n, 2000);
      for (const std::string& name : folder_.Names()) {
        if (name != "original.cairn") std::filesystem::remove(folder_.File(name));
      }
      std::filesystem::copy_file(original_, path_);
      FailingVfs vfs;
      vfs.FailAt(n, /*for_ever=*/true);
      const absl::Status status = change();
      const bool failed = vfs.failed() > 0;
      vfs.FailAt(0, false);
      SCOPED_TRACE(absl::StrCat("call ", n, ": ", status.ToString()));
      EXPECT_TRUE(status.ok() || failed);
      check(status);
      if (HasFatalFailure() || !failed) {
        EXPECT_GT(n, 10);
        return;
      }
    }
  }

  const TempFolder folder_;
  const std::string original_ = folder_.File("original.cairn"), path_ = folder_.File("a.cairn"),
                    out_ = folder_.File("out.cairn");
  const testing::Room room_{5, 500};
  const std::shared_ptr<const map::Snapshot> map_ = room_.Map(6, 3);
  std::string before_;
};

TEST_F(CareFaultTest, OfPruningAndCompacting) {
  std::string after;
  const auto prune = [&]() -> absl::Status {
    {
      CAIRN_ASSIGN_OR_RETURN(const auto live, engine::LiveMap::Open(path_));
      CAIRN_ASSIGN_OR_RETURN(const store::MapOverview overview, store::ReadMapOverview(path_));
      auto editor = live->BeginEdit();
      PruneOptions options;
      options.min_redundancy = 0.2;
      CAIRN_ASSIGN_OR_RETURN(const PrunePlan plan, PlanPruning(editor.View()->snapshot(), overview, options));
      CAIRN_RETURN_IF_ERROR(editor.Commit(plan.delta, {}));
    }
    CAIRN_ASSIGN_OR_RETURN(const auto store, store::OpenMapStore(path_, store::OpenMode::kWrite));
    CAIRN_RETURN_IF_ERROR(store->Compact());
    return store->Close();
  };
  std::filesystem::copy_file(original_, path_);
  ASSERT_TRUE(prune().ok());
  after = Digest(path_);
  ASSERT_NE(after, before_);
  EachCall(prune, [&](const absl::Status& status) {
    const std::string now = Digest(path_);
    EXPECT_TRUE(now == after || (!status.ok() && now == before_));
  });
}

TEST_F(CareFaultTest, OfWritingAnotherMap) {
  const auto write = [&] {
    return WriteNewMap(*map_, NewMapInfo(map_->info(), "other"), room_.words->Serialize(), out_, false, "made");
  };
  EachCall(write, [&](const absl::Status& status) {
    EXPECT_EQ(Digest(path_), before_);
    ASSERT_EQ(std::filesystem::exists(out_), status.ok());
    if (status.ok()) {
      EXPECT_FALSE(Digest(out_).empty());
    }
  });
}

}  // namespace
}  // namespace cairn::care

#include "engine/live_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <condition_variable>
#include <mutex>

#include "store/testing_maps.h"

namespace cairn::engine {
namespace {

using store::testing::MapGrower;
using store::testing::SameBits;
using store::testing::TempFolder;
using ::testing::HasSubstr;

// Keeps nothing, fails or waits when told to, and remembers what became durable.
class FakeStore : public store::MapStore {
 public:
  struct Control {
    std::mutex mutex;
    std::condition_variable changed;
    bool hold = false;
    absl::Status fail_with;
    std::vector<Revision> durable;
  };
  explicit FakeStore(Control* control) : control_(*control) {}

  absl::Status Commit(const map::Delta& delta) override {
    std::unique_lock lock(control_.mutex);
    control_.changed.wait(lock, [&] { return !control_.hold; });
    CAIRN_RETURN_IF_ERROR(control_.fail_with);
    exists_ |= !delta.keyframes.empty();
    control_.durable.push_back(delta.revision());
    return absl::OkStatus();
  }
  absl::Status Close() override { return absl::OkStatus(); }
  const std::string& uri() const override { return uri_; }
  bool writable() const override { return true; }
  bool exists() const override { return exists_; }
  const std::vector<std::string>& notes() const override { return notes_; }
  absl::StatusOr<std::optional<store::ReadyMap>> LoadReady(const store::ReadyOptions&) override { return std::nullopt; }
  absl::StatusOr<std::shared_ptr<const map::Snapshot>> LoadSnapshot(const store::LoadOptions&) override {
    return None();
  }
  absl::Status PutVocabulary(absl::string_view) override { return None(); }
  absl::StatusOr<std::string> LoadVocabulary() override { return None(); }
  absl::StatusOr<Revision> ReadRevision() override { return None(); }
  absl::StatusOr<std::optional<map::Delta>> ReadDelta(const map::Snapshot&) override { return None(); }
  absl::StatusOr<std::optional<map::ChangedRows>> ReadChangedRows(Revision) override { return None(); }
  absl::StatusOr<store::MapSummary> ReadSummary() override { return None(); }
  absl::StatusOr<std::vector<store::LoggedChange>> ReadChanges(const store::ChangeQuery&) override { return None(); }
  absl::StatusOr<std::vector<store::Finding>> Verify() override { return None(); }
  absl::StatusOr<std::string> ContentDigest() override { return None(); }
  absl::Status CopyTo(const std::string&) override { return None(); }
  absl::Status CopySound(const std::string&) override { return None(); }
  absl::Status Compact() override { return None(); }

 private:
  static absl::Status None() { return absl::UnimplementedError("not in this test"); }
  Control& control_;
  const std::string uri_ = "fake";
  const std::vector<std::string> notes_;
  bool exists_ = false;
};

class LiveMapTest : public ::testing::Test {
 protected:
  LiveMapTest() {
    map::MapInfo info = store::testing::TestInfo();
    info.vocabulary_hash = 0;
    live_ = *LiveMap::Over(std::make_unique<FakeStore>(&control_), map::Snapshot::Empty(info), nullptr);
  }
  ~LiveMapTest() override { Hold(false); }

  void Hold(bool hold) {
    const std::lock_guard lock(control_.mutex);
    control_.hold = hold;
    control_.changed.notify_all();
  }
  absl::Status Start() {
    auto editor = live_->BeginEdit();
    return editor.Commit(grower_.Start(editor.View()->snapshot()), {});
  }
  absl::Status AddKeyframe() {
    auto editor = live_->BeginEdit();
    return editor.Commit(grower_.AddKeyframe(editor.View()->snapshot()), {});
  }

  FakeStore::Control control_;
  MapGrower grower_{3};
  std::unique_ptr<LiveMap> live_;
};

TEST_F(LiveMapTest, NobodySeesWhatIsNotDurable) {
  ASSERT_TRUE(Start().ok());
  EXPECT_EQ(live_->Published()->revision(), 0u) << "the store keeps nothing before the first keyframe";
  ASSERT_TRUE(AddKeyframe().ok());
  EXPECT_EQ(live_->Published()->revision(), 2u);
  const auto changes = live_->Subscribe();
  ASSERT_TRUE(live_->StoreInBackground().ok());
  Hold(true);
  ASSERT_TRUE(AddKeyframe().ok()) << "an editor need not wait for the disk";
  EXPECT_EQ(live_->BeginEdit().View()->revision(), 3u) << "and goes on from there";
  EXPECT_EQ(live_->Published()->revision(), 2u);
  EXPECT_FALSE((*changes->Next(std::chrono::milliseconds(0))).has_value());
  Hold(false);
  ASSERT_TRUE(live_->Flush().ok());
  EXPECT_EQ(live_->Published()->revision(), 3u);
  const auto change = changes->Next(std::chrono::seconds(10));
  ASSERT_TRUE(change.ok() && change->has_value());
  EXPECT_EQ((*change)->delta->revision(), 3u);
  EXPECT_EQ((*change)->after, live_->Published());
}

TEST_F(LiveMapTest, EveryRevisionIsToldOnceAndInOrder) {
  const auto changes = live_->Subscribe();
  ASSERT_TRUE(Start().ok());
  for (int i = 0; i < 5; ++i) ASSERT_TRUE(AddKeyframe().ok());
  ASSERT_TRUE(live_->Close().ok());
  Revision last = changes->first()->revision();
  for (;;) {
    const auto change = changes->Next(std::chrono::seconds(10));
    if (!change.ok()) {
      EXPECT_TRUE(absl::IsCancelled(change.status()));
      break;
    }
    ASSERT_TRUE(change->has_value());
    EXPECT_EQ((*change)->delta->base, last);
    EXPECT_EQ((*change)->before->revision(), last);
    last = (*change)->delta->revision();
  }
  EXPECT_EQ(last, 6u) << "the begin of the session as well";
  EXPECT_THAT(control_.durable, ::testing::ElementsAre(1, 2, 3, 4, 5, 6));
}

TEST_F(LiveMapTest, WhoFallsBehindGetsTheRestAsOne) {
  ASSERT_TRUE(Start().ok());
  const auto changes = live_->Subscribe();
  const int count = static_cast<int>(Subscription::kMaxWaiting) + 20;
  for (int i = 0; i < count; ++i) ASSERT_TRUE(AddKeyframe().ok());
  std::shared_ptr<const map::Snapshot> followed = changes->first()->snapshot();
  std::size_t told = 0;
  for (;; ++told) {
    const auto change = changes->Next(std::chrono::milliseconds(0));
    ASSERT_TRUE(change.ok());
    if (!change->has_value()) break;
    const auto next = followed->Apply(*(*change)->delta);
    ASSERT_TRUE(next.ok()) << next.status();
    followed = *next;
  }
  EXPECT_EQ(told, Subscription::kMaxWaiting);
  EXPECT_TRUE(SameBits(*followed, live_->Published()->map()));
}

TEST_F(LiveMapTest, AChangeThatCannotBeStoredLeavesTheHeadAtWhatIsDurable) {
  ASSERT_TRUE(Start().ok());
  ASSERT_TRUE(AddKeyframe().ok());
  ASSERT_TRUE(live_->StoreInBackground().ok());
  {
    const std::lock_guard lock(control_.mutex);
    control_.fail_with = absl::ResourceExhaustedError("the disk is full");
  }
  ASSERT_TRUE(AddKeyframe().ok()) << "not known yet";
  EXPECT_THAT(std::string(AddKeyframe().message()), HasSubstr("the disk is full"));
  EXPECT_EQ(live_->BeginEdit().View()->revision(), 2u) << "no number is used twice for two contents";
  EXPECT_EQ(live_->Published()->revision(), 2u);
  EXPECT_FALSE(AddKeyframe().ok());
  EXPECT_FALSE(live_->Close().ok());
  EXPECT_THAT(control_.durable, ::testing::ElementsAre(1, 2));
}

TEST_F(LiveMapTest, ABadChangeChangesNothing) {
  ASSERT_TRUE(Start().ok());
  ASSERT_TRUE(AddKeyframe().ok());
  auto editor = live_->BeginEdit();
  map::Edit edit(editor.View()->snapshot());
  map::MapCamera camera;
  camera.name = "broken";
  edit.AddCamera(camera);
  EXPECT_EQ(editor.Commit(edit.Finish("a camera without a focal length"), {}).code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(editor.Commit(grower_.AddKeyframe(editor.View()->snapshot()), {}).ok());
  EXPECT_EQ(editor.View()->revision(), 3u);
}

TEST(LiveMap, WhatIsUnderWayWhenItIsDestroyedIsStored) {
  const TempFolder folder;
  map::MapInfo info = store::testing::TestInfo();
  info.vocabulary_hash = 0;
  std::shared_ptr<const map::Snapshot> last;
  {
    auto live = LiveMap::Create(folder.File("map.cairn"), info, nullptr);
    ASSERT_TRUE(live.ok()) << live.status();
    ASSERT_TRUE((*live)->StoreInBackground().ok());
    MapGrower grower(4);
    auto editor = (*live)->BeginEdit();
    ASSERT_TRUE(editor.Commit(grower.Start(editor.View()->snapshot()), {}).ok());
    for (int i = 0; i < 6; ++i) {
      ASSERT_TRUE(editor.Commit(grower.AddKeyframe(editor.View()->snapshot()), {}).ok());
    }
    last = editor.View()->snapshot();
  }
  const auto reopened = LiveMap::Open(folder.File("map.cairn"));
  ASSERT_TRUE(reopened.ok()) << reopened.status();
  EXPECT_TRUE(SameBits((*reopened)->Published()->map(), *last));
  EXPECT_TRUE((*reopened)->Close().ok());
}

}  // namespace
}  // namespace cairn::engine

#include "wire/convert_deltas.h"

#include <gtest/gtest.h>

#include "map/region.h"
#include "store/digest.h"
#include "store/map_store.h"
#include "store/testing_maps.h"
#include "store/testing_mutator.h"
#include "wire/testing_messages.h"

namespace cairn::wire {
namespace {

using store::testing::MapMutator;
using store::testing::SameBits;
using store::testing::SnapshotPtr;
using store::testing::TestInfo;

using Messages = std::vector<v1::FollowMapResponse>;

Messages Written(const map::Snapshot& map, const map::ChangedRows& rows, absl::string_view vocabulary = {},
                 const std::vector<KeyframeId>* only = nullptr) {
  Messages messages;
  EXPECT_TRUE(WriteUpdate(map, rows, vocabulary, only, [&](const v1::FollowMapResponse& message) {
    messages.push_back(OverTheWire(message));
    return true;
  }));
  return messages;
}

// The update in all messages, none more, none fewer.
absl::StatusOr<MapUpdate> ReadAll(const Messages& messages, const SnapshotPtr& held) {
  UpdateReader reader(held);
  for (std::size_t i = 0; i < messages.size(); ++i) {
    CAIRN_ASSIGN_OR_RETURN(const bool last, reader.Read(messages[i]));
    if (last) return i + 1 == messages.size() ? reader.Take() : absl::InternalError("it ends too early");
  }
  return absl::DataLossError("it does not end");
}

absl::StatusOr<SnapshotPtr> Followed(const Messages& messages, const SnapshotPtr& held) {
  CAIRN_ASSIGN_OR_RETURN(const MapUpdate update, ReadAll(messages, held));
  CAIRN_ASSIGN_OR_RETURN(SnapshotPtr map, Applied(update));
  if (update.keyframes != static_cast<std::int64_t>(map->keyframes().size()) ||
      (update.points >= 0 && update.points != static_cast<std::int64_t>(map->points().size()))) {
    return absl::DataLossError("it is another map");
  }
  return map;
}

std::vector<SnapshotPtr> HistoryOf(std::uint64_t seed, int changes) {
  MapMutator mutator(seed);
  std::vector<SnapshotPtr> history = {map::Snapshot::Empty(TestInfo())};
  for (int i = 0; i < changes; ++i) {
    const auto next = history.back()->Apply(i == 0 ? mutator.Start(history.back()) : mutator.Next(history.back()));
    EXPECT_TRUE(next.ok()) << next.status();
    history.push_back(*next);
  }
  return history;
}

TEST(ConvertDeltas, AViewIsTheMapToTheBit) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const SnapshotPtr map = HistoryOf(seed, 50).back();
    const auto followed = Followed(Written(*map, map::AllRows(*map)), nullptr);
    ASSERT_TRUE(followed.ok()) << followed.status();
    EXPECT_TRUE(SameBits(**followed, *map));
    EXPECT_TRUE((*followed)->CheckConsistency().ok());
    EXPECT_EQ(store::ContentDigest(**followed), store::ContentDigest(*map));
    // In place of whatever was held.
    const auto replaced = Followed(Written(*map, map::AllRows(*map)), HistoryOf(seed + 10, 5).back());
    ASSERT_TRUE(replaced.ok()) << replaced.status();
    EXPECT_TRUE(SameBits(**replaced, *map));
  }
}

TEST(ConvertDeltas, ChangesLeadFromAnyRevisionToTheNewest) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const std::vector<SnapshotPtr> history = HistoryOf(seed, 60);
    for (std::size_t i = 1; i < history.size(); ++i) {
      for (const std::size_t k : {i, std::min(i + 1, history.size() - 1), history.size() - 1}) {
        const auto followed = Followed(Written(*history[k], map::RowsBetween(*history[i], *history[k])), history[i]);
        ASSERT_TRUE(followed.ok()) << i << " to " << k << ": " << followed.status();
        EXPECT_TRUE(SameBits(**followed, *history[k])) << i << " to " << k;
      }
    }
  }
}

// What the store knows of the rows names some that are as they were, and some that never were in what is held.
TEST(ConvertDeltas, ChangesThatTheStoreNames) {
  const store::testing::TempFolder folder;
  auto store = *store::CreateMapStore(folder.File("a.cairn"), TestInfo(), {.write = {.sync_every_commit = false}});
  MapMutator mutator(4);
  std::vector<SnapshotPtr> history = {map::Snapshot::Empty(TestInfo())};
  for (int i = 0; i < 60; ++i) {
    const map::Delta delta = i == 0 ? mutator.Start(history.back()) : mutator.Next(history.back());
    ASSERT_TRUE(store->Commit(delta).ok());
    history.push_back(*history.back()->Apply(delta));
  }
  for (std::size_t i = 1; i < history.size(); ++i) {
    // A view is taken, and then the store goes on.
    const SnapshotPtr& newest = history[std::min(history.size() - 1, i + 40)];
    const auto rows = store->ReadChangedRows(history[i]->revision());
    ASSERT_TRUE(rows.ok() && rows->has_value()) << rows.status();
    const auto followed = Followed(Written(*newest, **rows), history[i]);
    ASSERT_TRUE(followed.ok()) << i << ": " << followed.status();
    EXPECT_TRUE(SameBits(**followed, *newest)) << i;
  }
}

TEST(ConvertDeltas, MessagesAreBoundedAndTheVocabularyIsOneOfThem) {
  store::testing::MapGrower grower(5, {.features = 1500, .new_points = 200});
  SnapshotPtr map = map::Snapshot::Empty(TestInfo());
  map = *map->Apply(grower.Start(map));
  for (int i = 0; i < 20; ++i) map = *map->Apply(grower.AddKeyframe(map));
  const std::string vocabulary(3'000'000, 'v');
  const Messages messages = Written(*map, map::AllRows(*map), vocabulary);
  EXPECT_GT(messages.size(), 10u);
  for (const v1::FollowMapResponse& message : messages) EXPECT_LT(message.ByteSizeLong(), 1200u << 10);
  const auto update = ReadAll(messages, nullptr);
  ASSERT_TRUE(update.ok()) << update.status();
  EXPECT_EQ(update->vocabulary, vocabulary);
  // A pose alone costs no features and no points.
  map::Edit edit(map);
  edit.SetPose(KeyframeId(3), SE3(ExpSO3(Vector3d(0, 0.1, 0)), Vector3d(1, 0, 0)));
  const SnapshotPtr moved = *map->Apply(edit.Finish("a pose"));
  const map::ChangedRows rows = map::RowsBetween(*map, *moved);
  ASSERT_EQ(rows.keyframes.size(), 1u);
  const auto change = ReadAll(Written(*moved, rows), map);
  ASSERT_TRUE(change.ok()) << change.status();
  EXPECT_EQ(change->delta.keyframes[0]->features, map->keyframe(KeyframeId(3)).features) << "shared";
  EXPECT_LT(change->bytes, 500 + 40 * static_cast<std::int64_t>(rows.points.size()));
}

// The region of a map around a keyframe that moves on, step by step and as a whole.
TEST(ConvertDeltas, ARegionIsAMapByItselfThatMovesAndChanges) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const std::vector<SnapshotPtr> history = HistoryOf(seed, 70);
    SnapshotPtr held;
    std::vector<KeyframeId> had;
    int rebuilt = 0;
    for (std::size_t i = 10; i < history.size(); i += 1 + i % 3) {
      const map::Snapshot& map = *history[i];
      map::RegionQuery query;
      query.around = {KeyframeId(static_cast<KeyframeId::Value>(1 + (i * 7) % map.keyframes().size()))};
      query.component = ComponentId(1);
      query.max_keyframes = 5;
      const std::vector<KeyframeId> has = map::KeyframesAround(map, query);
      ASSERT_FALSE(has.empty());
      const auto whole = Followed(Written(map, map::RowsOfRegion({}, map::AllRows(map), map, has), {}, &has), nullptr);
      ASSERT_TRUE(whole.ok()) << whole.status();
      EXPECT_TRUE((*whole)->CheckConsistency().ok()) << (*whole)->CheckConsistency();
      EXPECT_EQ((*whole)->keyframes().size(), has.size());
      if (held != nullptr) {
        const map::ChangedRows changed = map::RowsBetween(*history[held->revision()], map);
        const Messages messages = Written(map, map::RowsOfRegion(had, changed, map, has), {}, &has);
        const auto update = ReadAll(messages, held);
        ASSERT_TRUE(update.ok()) << update.status();
        rebuilt += NeedsRebuilding(*update);
        const auto moved = Followed(messages, held);
        ASSERT_TRUE(moved.ok()) << moved.status();
        EXPECT_TRUE(SameBits(**moved, **whole)) << i;
      }
      held = *whole;
      had = has;
    }
    EXPECT_GT(rebuilt, 0) << "what was there before comes into the region";
  }
}

TEST(ConvertDeltas, WritingEndsWhenNobodyReads) {
  const SnapshotPtr map = HistoryOf(1, 30).back();
  for (int taken = 0; taken < 3; ++taken) {
    int sent = 0;
    EXPECT_FALSE(WriteUpdate(*map, map::AllRows(*map), "vocabulary", nullptr,
                             [&](const v1::FollowMapResponse&) { return sent++ < taken; }));
    EXPECT_EQ(sent, taken + 1);
  }
}

TEST(ConvertDeltas, WhatIsNoUpdateIsRefused) {
  const std::vector<SnapshotPtr> history = HistoryOf(2, 40);
  const SnapshotPtr &held = history[20], &map = history.back();
  const Messages good = Written(*map, map::RowsBetween(*held, *map));
  const auto refused = [&](const Messages& messages, const SnapshotPtr& base) {
    const auto followed = Followed(messages, base);
    return !followed.ok() && !followed.status().message().empty();
  };
  ASSERT_TRUE(Followed(good, held).ok());
  EXPECT_TRUE(refused(good, nullptr)) << "nothing is held";
  EXPECT_TRUE(refused(good, history[19])) << "something else is held";
  EXPECT_TRUE(refused({good.begin() + 1, good.end()}, held)) << "no beginning";
  EXPECT_TRUE(refused({good.begin(), good.end() - 1}, held)) << "no end";
  Messages changed = good;
  changed.erase(changed.begin() + 1);
  EXPECT_TRUE(refused(changed, held)) << "rows are missing";
  changed = good;
  changed.insert(changed.begin() + 1, good[0]);
  EXPECT_TRUE(refused(changed, held)) << "two beginnings";
  changed = good;
  changed.insert(changed.begin() + 1, v1::FollowMapResponse());
  changed[1].mutable_up_to_date();
  EXPECT_TRUE(refused(changed, held)) << "an answer within another";
  changed = good;
  changed[0].mutable_begin()->set_vocabulary_bytes(5);
  EXPECT_TRUE(refused(changed, held)) << "a vocabulary that does not come";
  const auto with = [&](auto change) {
    changed = Written(*map, map::AllRows(*map));
    for (v1::FollowMapResponse& message : changed) {
      if (message.has_begin()) change(message.mutable_begin(), static_cast<v1::UpdateRows*>(nullptr));
      if (message.has_rows()) change(static_cast<v1::UpdateBegin*>(nullptr), message.mutable_rows());
    }
    // The count of bytes is no secret.
    std::int64_t bytes = 0;
    for (const v1::FollowMapResponse& message : changed) {
      bytes += message.has_rows() ? static_cast<std::int64_t>(message.rows().ByteSizeLong()) : 0;
    }
    changed.back().mutable_end()->set_rows_bytes(bytes);
    return refused(changed, nullptr);
  };
  EXPECT_FALSE(with([](v1::UpdateBegin*, v1::UpdateRows*) {}));
  EXPECT_TRUE(with([](v1::UpdateBegin* begin, v1::UpdateRows*) { begin ? begin->clear_head() : void(); })) << "no head";
  EXPECT_TRUE(with([](v1::UpdateBegin* begin, v1::UpdateRows*) { begin ? begin->set_revision(0) : void(); }));
  EXPECT_TRUE(with([](v1::UpdateBegin* begin, v1::UpdateRows*) { begin ? begin->set_next_point(2) : void(); }))
      << "ids that are not free";
  EXPECT_TRUE(with([](v1::UpdateBegin*, v1::UpdateRows* rows) { rows ? rows->clear_cameras() : void(); }));
  EXPECT_TRUE(with([](v1::UpdateBegin*, v1::UpdateRows* rows) { rows ? rows->clear_keyframes() : void(); }));
  const auto with_keyframe = [&](auto change) {
    return with([&](v1::UpdateBegin*, v1::UpdateRows* rows) {
      if (rows != nullptr && rows->keyframes_size() > 0) change(rows->mutable_keyframes(0));
    });
  };
  EXPECT_TRUE(with_keyframe([](v1::KeyframeRow* row) { row->clear_features(); }));
  EXPECT_TRUE(with_keyframe([](v1::KeyframeRow* row) { row->set_has_points(false); }));
  EXPECT_TRUE(with_keyframe([](v1::KeyframeRow* row) { row->clear_camera_from_map(); })) << "no unit quaternion";
  EXPECT_TRUE(with_keyframe([](v1::KeyframeRow* row) { row->mutable_features()->set_count(1'000'000'000); }));
  EXPECT_TRUE(with_keyframe([](v1::KeyframeRow* row) { row->mutable_features()->mutable_descriptors()->pop_back(); }));
  EXPECT_TRUE(with_keyframe([](v1::KeyframeRow* row) { row->add_covisible(3); })) << "no count";
  EXPECT_TRUE(with_keyframe([](v1::KeyframeRow* row) { row->set_camera(77); }));
  EXPECT_TRUE(with_keyframe([](v1::KeyframeRow* row) { row->set_id(0); }));
  const auto with_points = [&](auto change) {
    return with([&](v1::UpdateBegin*, v1::UpdateRows* rows) {
      if (rows != nullptr && rows->has_points()) change(rows->mutable_points());
    });
  };
  EXPECT_TRUE(with_points([](v1::PointRows* rows) { rows->mutable_positions()->pop_back(); }));
  EXPECT_TRUE(with_points([](v1::PointRows* rows) { rows->mutable_ids()->set_count(4'000'000'000u); }));
  EXPECT_TRUE(with_points([](v1::PointRows* rows) { rows->set_times_found(0, 4'000'000'000u); }));
  EXPECT_TRUE(with_points([](v1::PointRows* rows) { rows->set_reference_keyframes(0, 99'999); }));
}

// Whatever the bytes are: an error, or a map that is a good one.
TEST(ConvertDeltas, SpoiledBytesAreAnErrorOrAGoodMap) {
  const std::vector<SnapshotPtr> history = HistoryOf(6, 40);
  const SnapshotPtr &held = history[25], &map = history.back();
  std::vector<std::string> good;
  for (const v1::FollowMapResponse& message : Written(*map, map::RowsBetween(*held, *map))) {
    good.push_back(message.SerializeAsString());
  }
  Random random(8);
  int refused = 0;
  for (int i = 0; i < 3000; ++i) {
    std::vector<std::string> bytes = good;
    std::string& spoiled = bytes[random.Below(bytes.size())];
    if (spoiled.empty()) continue;
    for (std::uint64_t k = 0; k <= random.Below(3); ++k) {
      spoiled[random.Below(spoiled.size())] = static_cast<char>(random.Below(256));
    }
    Messages messages;
    for (const std::string& one : bytes) {
      if (!messages.emplace_back().ParseFromString(one)) messages.clear();
    }
    const auto followed = Followed(messages, held);
    if (followed.ok()) {
      EXPECT_TRUE((*followed)->CheckConsistency().ok());
    } else {
      ++refused;
    }
  }
  EXPECT_GT(refused, 300);
}

}  // namespace
}  // namespace cairn::wire

#include "care/session_removal.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "care/whole_map.h"
#include "map/plausibility.h"
#include "map/testing_two_visits.h"
#include "store/testing_maps.h"

namespace cairn::care {
namespace {

class SessionRemovalTest : public ::testing::Test {
 protected:
  SessionRemovalTest() {
    EXPECT_TRUE(WriteNewMap(*visits_.map, NewMapInfo(visits_.map->info(), "visits"), "", path_, false, "made").ok());
    live_ = *engine::LiveMap::Open(path_);
  }
  const map::Snapshot& map() { return live_->Published()->map(); }

  const map::testing::TwoVisits visits_ = map::testing::MakeTwoVisits();
  const store::testing::TempFolder folder_;
  const std::string path_ = folder_.File("visits.cairn");
  std::unique_ptr<engine::LiveMap> live_;
};

TEST_F(SessionRemovalTest, WhatOthersSeeStays) {
  const auto before = live_->Published();
  const auto removal = RemoveSession("visits", visits_.first, *live_);
  ASSERT_TRUE(removal.ok()) << removal.status();
  EXPECT_EQ(removal->keyframes, 5);
  EXPECT_EQ(removal->revision, before->revision() + 1) << "one change";
  EXPECT_THAT(removal->removed_components, ::testing::IsEmpty());
  EXPECT_EQ(removal->adjusted_keyframes, 5);
  ASSERT_TRUE(map().CheckConsistency().ok()) << map().CheckConsistency();
  EXPECT_TRUE(map().sessions().at(visits_.first).removed);
  // Keyframes of the others are as they were, but for what only the first session shared with them.
  std::int64_t gone = 0;
  before->map().keyframes().ForEach([&](const auto& was) {
    const map::Keyframe* is = map().keyframes().Find(was->id);
    ASSERT_EQ(is != nullptr, was->session != visits_.first) << was->id.value();
    if (is == nullptr) return;
    EXPECT_EQ(is->features->features.size(), was->features->features.size());
    for (std::size_t i = 0; i < was->points.size(); ++i) {
      EXPECT_TRUE(!is->points[i] || is->points[i] == was->points[i]);
    }
  });
  before->map().points().ForEach([&](const auto& point) {
    const auto others = std::ranges::count_if(point->observations, [&](const map::Observation& o) {
      return before->map().keyframe(o.keyframe).session != visits_.first;
    });
    if (others < 2) {
      EXPECT_EQ(map().points().Find(point->id), nullptr);
      ++gone;
    }
  });
  EXPECT_GE(removal->points, gone);
  EXPECT_LT(removal->points, gone + 20) << "outliers of the adjustment at most";
  // The other component was not touched.
  for (const KeyframeId id : {KeyframeId(11), KeyframeId(20)}) {
    EXPECT_EQ(map().keyframe(id).camera_from_map.translation(),
              before->map().keyframe(id).camera_from_map.translation());
  }
  EXPECT_TRUE(
      map::FindImplausible(map(), {}, [](const map::Implausibility& what) { ADD_FAILURE() << what.message; }).ok());
}

TEST_F(SessionRemovalTest, AnAlignedComponentStaysInTheWorld) {
  const auto before = live_->Published();
  ASSERT_TRUE(RemoveSession("visits", visits_.first, *live_).ok());
  const Sim3 world = *map().WorldFrom(visits_.shared);
  EXPECT_EQ(world.scale(), before->map().WorldFrom(visits_.shared)->scale());
  map().keyframes().ForEach([&](const auto& keyframe) {
    if (keyframe->component != visits_.shared) return;
    const Vector3d moved = world * keyframe->CenterInMap() - world * before->map().keyframe(keyframe->id).CenterInMap();
    EXPECT_LT(moved.norm(), 0.03) << "half a pixel at 4 units, of which a metre has two";
  });
  // It is on disk as it is in memory.
  ASSERT_TRUE(live_->Close().ok());
  const auto store = store::OpenMapStore(path_, store::OpenMode::kRead);
  ASSERT_TRUE(store.ok()) << store.status();
  EXPECT_THAT(*(*store)->Verify(), ::testing::IsEmpty());
  EXPECT_TRUE(store::testing::SameBits(**(*store)->LoadSnapshot(), map()));
}

TEST_F(SessionRemovalTest, AComponentOfItsOwnGoesAsAWhole) {
  const auto before = live_->Published();
  const auto removal = RemoveSession("visits", visits_.apart, *live_);
  ASSERT_TRUE(removal.ok()) << removal.status();
  EXPECT_THAT(removal->removed_components, ::testing::ElementsAre(visits_.alone));
  EXPECT_EQ(removal->adjusted_keyframes, 0);
  EXPECT_FALSE(map().components().contains(visits_.alone));
  EXPECT_EQ(map().keyframes().size(), 10u);
  ASSERT_TRUE(map().CheckConsistency().ok());
  // Nothing of the rest is another.
  for (KeyframeId id(1); id < KeyframeId(11); id = KeyframeId(id.value() + 1)) {
    EXPECT_EQ(&map().keyframe(id), &before->map().keyframe(id));
  }
}

TEST_F(SessionRemovalTest, OneAfterTheOtherLeavesAnEmptyMap) {
  for (const SessionId session : {visits_.second, visits_.first, visits_.apart}) {
    const auto removal = RemoveSession("visits", session, *live_);
    ASSERT_TRUE(removal.ok()) << removal.status();
    ASSERT_TRUE(map().CheckConsistency().ok());
  }
  EXPECT_TRUE(map().keyframes().empty());
  EXPECT_TRUE(map().points().empty());
  EXPECT_TRUE(map().components().empty());
  EXPECT_EQ(map().sessions().size(), 3u) << "they stay in the history";
}

TEST_F(SessionRemovalTest, RefusesWhatIsNotThere) {
  EXPECT_TRUE(absl::IsNotFound(RemoveSession("visits", SessionId(9), *live_).status()));
  ASSERT_TRUE(RemoveSession("visits", visits_.second, *live_).ok());
  const absl::Status again = RemoveSession("visits", visits_.second, *live_).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(again));
  EXPECT_THAT(std::string(again.message()), ::testing::HasSubstr("removed already"));
}

}  // namespace
}  // namespace cairn::care

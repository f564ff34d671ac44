#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <thread>

#include "client/conformance/conformance_map.h"
#include "client/view_feed.h"
#include "host/hosted_map.h"
#include "map/edit.h"

namespace cairn::host {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kInterval(0);  // between two looks at the file

class MapFeedTest : public testing::Test {
 protected:
  void SetUp() override {
    path_ = testing::TempDir() + "/map_feed_test_" + std::to_string(getpid()) + ".cairn";
    std::remove(path_.c_str());
    ASSERT_TRUE(conformance::WriteConformanceMap(path_).ok());
    auto live = engine::LiveMap::Open(path_);
    ASSERT_TRUE(live.ok()) << live.status();
    hosted_ = HostedMap::Over(path_, *std::move(live), kInterval, &live_);
  }
  void TearDown() override {
    live_.reset();
    std::remove(path_.c_str());
  }

  client::FeedSource Source() {
    client::FeedSource source;
    source.newest = [this] { return hosted_->View(); };
    source.wait = [this, news = std::shared_ptr<engine::Subscription>()](
                      Revision, client::FeedSource::Clock::time_point until) mutable {
      hosted_->WaitForChange(until, &news);
    };
    source.changed_since = [this](Revision since) -> absl::StatusOr<std::optional<map::ChangedRows>> {
      CAIRN_ASSIGN_OR_RETURN(const auto store, store::OpenMapStore(path_, store::OpenMode::kRead));
      return store->ReadChangedRows(since);
    };
    return source;
  }
  // Another scale of the world.
  void Align(double scale) {
    const auto revision = live_->Edit([&](const map::Snapshot& head) -> absl::StatusOr<std::optional<map::Delta>> {
      map::Edit edit(std::make_shared<const map::Snapshot>(head));
      map::Component component = head.component(ComponentId(1));
      component.world_from_component = Sim3(Quaterniond::Identity(), Vector3d::Zero(), scale);
      edit.PutComponent(component);
      return edit.Finish("aligned");
    });
    ASSERT_TRUE(revision.ok()) << revision.status();
  }

  std::string path_;
  std::shared_ptr<engine::LiveMap> live_;
  std::shared_ptr<HostedMap> hosted_;
};

TEST_F(MapFeedTest, AViewFirstAndThenWhatChanges) {
  client::ViewFeed feed(Source(), {});
  const auto view = feed.Next(milliseconds(0));
  ASSERT_TRUE(view.ok() && *view) << view.status();
  EXPECT_TRUE((*view)->rows.whole);
  EXPECT_EQ((*view)->rows, map::AllRows(*(*view)->map));
  EXPECT_FALSE(feed.Vocabulary().empty());
  EXPECT_FALSE(feed.Next(milliseconds(0))->has_value());
  // Wakes up at once.
  std::thread editor([&] { Align(3.0); });
  const auto change = feed.Next(std::chrono::hours(1));
  editor.join();
  ASSERT_TRUE(change.ok() && *change) << change.status();
  EXPECT_FALSE((*change)->rows.whole);
  EXPECT_EQ((*change)->rows.base, (*view)->map->revision());
  EXPECT_THAT((*change)->rows.components, testing::ElementsAre(ComponentId(1)));
  EXPECT_TRUE((*change)->rows.keyframes.empty());
}

TEST_F(MapFeedTest, WhoReadsSlowlyGetsWhatChangedAsOne) {
  client::ViewFeed feed(Source(), {});
  const Revision before = (*feed.Next(milliseconds(0)))->map->revision();
  EXPECT_FALSE(feed.Next(milliseconds(1))->has_value());  // subscribed
  constexpr int kChanges = 200;
  for (int i = 0; i < kChanges; ++i) Align(1.0 + i);
  const auto change = feed.Next(milliseconds(0));
  ASSERT_TRUE(change.ok() && *change) << change.status();
  EXPECT_EQ((*change)->rows.base, before);
  EXPECT_EQ((*change)->map->revision(), before + kChanges);
  EXPECT_EQ((*change)->map->WorldFrom(ComponentId(1))->scale(), kChanges);
  EXPECT_FALSE(feed.Next(milliseconds(0))->has_value()) << "nothing is queued";
}

TEST_F(MapFeedTest, WhatChangesWithinTheIntervalComesAsOne) {
  api::FollowRequest request;
  request.min_interval = std::chrono::hours(1);
  client::ViewFeed feed(Source(), request);
  ASSERT_TRUE(feed.Next(milliseconds(0))->has_value());
  Align(5.0);
  EXPECT_FALSE(feed.Next(milliseconds(5))->has_value());
}

TEST_F(MapFeedTest, GoesOnFromWhatTheFollowerHas) {
  const auto first = live_->Published();
  Align(2.5);
  api::FollowRequest request{first->map().info().id, first->revision()};
  {
    client::ViewFeed feed(Source(), request);
    const auto change = feed.Next(milliseconds(0));
    ASSERT_TRUE(change.ok() && *change) << change.status();
    EXPECT_FALSE((*change)->rows.whole);
    EXPECT_EQ((*change)->rows.base, first->revision());
    EXPECT_THAT((*change)->rows.components, testing::ElementsAre(ComponentId(1)));
    EXPECT_TRUE((*change)->rows.points.empty());
  }
  request.revision = live_->Published()->revision();
  const auto none = client::ViewFeed(Source(), request).Next(milliseconds(0));
  ASSERT_TRUE(none.ok() && *none) << "told at once that it is up to date";
  EXPECT_FALSE((*none)->rows.whole);
  EXPECT_TRUE((*none)->rows.components.empty());
  request.revision += 1;
  EXPECT_TRUE((*client::ViewFeed(Source(), request).Next(milliseconds(0)))->rows.whole) << "of another history";
  request = {"ffffffffffffffffffffffffffffffff", first->revision()};
  EXPECT_TRUE((*client::ViewFeed(Source(), request).Next(milliseconds(0)))->rows.whole) << "of another map";
}

// What was published last is known without looking, while it is written and after, and readers share it.
TEST_F(MapFeedTest, TheNewestViewIsKeptAndSharedWhenTheWriterIsGone) {
  const auto reader = hosted_->NewReader();
  ASSERT_TRUE(reader.ok()) << reader.status();
  EXPECT_EQ((*reader)->view(), live_->Published()) << "nothing is read again";
  Align(2.0);
  EXPECT_EQ(hosted_->Known(), live_->Published());
  const auto published = live_->Published();
  live_.reset();
  EXPECT_EQ(hosted_->Known(), published);
  EXPECT_TRUE(*(*reader)->Refresh());
  EXPECT_EQ((*reader)->view(), published) << "the file has nothing newer";
  EXPECT_EQ((*hosted_->NewReader())->view(), published);
  // Another process goes on.
  auto other = engine::LiveMap::Open(path_);
  ASSERT_TRUE(other.ok()) << other.status();
  live_ = *std::move(other);
  Align(4.0);
  live_.reset();
  EXPECT_TRUE(*(*reader)->Refresh());
  EXPECT_EQ((*reader)->view()->revision(), published->revision() + 1);
  EXPECT_EQ((*reader)->view()->map().WorldFrom(ComponentId(1))->scale(), 4.0);
}

}  // namespace
}  // namespace cairn::host

#include "engine/frame_feed.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <future>
#include <new>
#include <thread>
#include <vector>

namespace cairn::engine {
namespace {

using ::testing::HasSubstr;

SessionSource TestSource() {
  SessionSource source;
  source.name = "test";
  source.camera.width_px = 64;
  source.camera.height_px = 48;
  source.camera.fx_px = source.camera.fy_px = 60.0;
  source.camera.cx_px = 31.5;
  source.camera.cy_px = 23.5;
  return source;
}

FramePreparation MakePreparation() {
  auto preparation = FramePreparation::Create(TestSource());
  EXPECT_TRUE(preparation.ok()) << preparation.status();
  return *std::move(preparation);
}

// Frames 0 to count - 1, a nanosecond apart; `at_end` is called when more are asked for.
FrameFeed::Read Recording(
    int count, std::function<void()> at_end = [] {}) {
  return [count, at_end, next = 0]() mutable -> absl::StatusOr<std::optional<RawFrame>> {
    if (next == count) {
      at_end();
      return std::optional<RawFrame>();
    }
    RawFrame frame;
    frame.index = next;
    frame.time_ns = 1000 + next;
    frame.gray = cv::Mat(48, 64, CV_8UC1, cv::Scalar(next));
    ++next;
    return std::optional<RawFrame>(frame);
  };
}

std::vector<std::int64_t> TakeAll(FrameFeed& feed) {
  std::vector<std::int64_t> indices;
  for (;;) {
    auto fed = feed.Next();
    EXPECT_TRUE(fed.ok()) << fed.status();
    if (!fed.ok() || !fed->has_value()) return indices;
    indices.push_back((*fed)->frame.index);
  }
}

TEST(FrameFeed, GivesEveryFrameInOrderWithAndWithoutAThread) {
  const FramePreparation preparation = MakePreparation();
  for (const bool in_background : {false, true}) {
    FrameFeedOptions options;
    options.in_background = in_background;
    options.ahead = 3;
    FrameFeed feed(options, preparation, Recording(20));
    const std::vector<std::int64_t> indices = TakeAll(feed);
    ASSERT_EQ(indices.size(), 20u);
    for (std::int64_t i = 0; i < 20; ++i) EXPECT_EQ(indices[static_cast<std::size_t>(i)], i);
    EXPECT_EQ(feed.dropped(), 0);
    EXPECT_TRUE(TakeAll(feed).empty());
  }
}

TEST(FrameFeed, ReadsNoFurtherAheadThanAllowed) {
  const FramePreparation preparation = MakePreparation();
  FrameFeedOptions options;
  options.ahead = 2;
  std::atomic<int> read = 0;
  FrameFeed feed(options, preparation, [&, recording = Recording(50)]() mutable {
    ++read;
    return recording();
  });
  for (int taken = 1; taken <= 50; ++taken) {
    const auto fed = feed.Next();
    ASSERT_TRUE(fed.ok() && fed->has_value());
    EXPECT_LE(read, taken + 2 + 1);  // waiting, and one in the hand
  }
}

TEST(FrameFeed, ALiveCameraReplacesTheWaitingFrameAndCountsIt) {
  const FramePreparation preparation = MakePreparation();
  FrameFeedOptions options;
  options.realtime_speed = 1.0;
  std::promise<void> all_arrived;
  FrameFeed feed(options, preparation, Recording(10, [&] { all_arrived.set_value(); }));
  all_arrived.get_future().wait();
  const auto fed = feed.Next();
  ASSERT_TRUE(fed.ok() && fed->has_value());
  EXPECT_EQ((*fed)->frame.index, 9);
  EXPECT_EQ((*fed)->dropped_before, 9);
  EXPECT_TRUE(TakeAll(feed).empty());
  EXPECT_EQ(feed.dropped(), 9);
}

TEST(FrameFeed, WhatALiveCameraSawDuringAStallIsGivenAfterIt) {
  const FramePreparation preparation = MakePreparation();
  // After the first frame nothing is taken until all have arrived.
  const auto taken = [&](const FrameFeedOptions& options, std::int64_t* dropped) {
    std::promise<void> first_taken;
    std::promise<void> all_arrived;
    FrameFeed feed(options, preparation,
                   [&, recording = Recording(10, [&] { all_arrived.set_value(); }), read = 0]() mutable {
                     if (read++ == 1) first_taken.get_future().wait();
                     return recording();
                   });
    const auto first = feed.Next();
    EXPECT_TRUE(first.ok() && first->has_value());
    const auto stalled = std::chrono::steady_clock::now();
    first_taken.set_value();
    all_arrived.get_future().wait();
    while (std::chrono::steady_clock::now() - stalled < std::chrono::milliseconds(300)) std::this_thread::yield();
    const std::vector<std::int64_t> indices = TakeAll(feed);
    *dropped = feed.dropped();
    return indices;
  };
  FrameFeedOptions options;
  options.realtime_speed = 1.0;
  options.stall_s = 0.01;
  std::int64_t dropped = 0;
  EXPECT_EQ(taken(options, &dropped), (std::vector<std::int64_t>{1, 2, 3, 4, 5, 6, 7, 8, 9}));
  EXPECT_EQ(dropped, 0);
  const Pinhole& view = preparation.pinhole();
  options.kept_bytes = std::size_t{3} * static_cast<std::size_t>(view.width_px * view.height_px) + 1;
  EXPECT_EQ(taken(options, &dropped), (std::vector<std::int64_t>{7, 8, 9}));
  EXPECT_EQ(dropped, 6);
  options.stall_s = 3600.0;  // busy, but there: what it could not take is old
  EXPECT_EQ(taken(options, &dropped), std::vector<std::int64_t>{9});
  EXPECT_EQ(dropped, 8);
}

TEST(FrameFeed, ALiveCameraKeepsThePace) {
  const FramePreparation preparation = MakePreparation();
  FrameFeedOptions options;
  options.realtime_speed = 2.0;
  const auto start = std::chrono::steady_clock::now();
  FrameFeed feed(options, preparation, [recording = Recording(3)]() mutable {
    auto frame = recording();
    if (frame.ok() && frame->has_value()) (*frame)->time_ns = (*frame)->index * 20'000'000;
    return frame;
  });
  std::int64_t last = -1;
  for (;;) {
    const auto fed = feed.Next();
    ASSERT_TRUE(fed.ok());
    if (!fed->has_value()) break;
    last = (*fed)->frame.index;
    EXPECT_GE((*fed)->arrival - start, std::chrono::milliseconds(10 * last));  // never before it is due
  }
  EXPECT_EQ(last, 2);
}

TEST(FrameFeed, StopEndsItAtOnce) {
  const FramePreparation preparation = MakePreparation();
  FrameFeedOptions live;
  live.realtime_speed = 1e-9;  // the second frame is due in a second, those after it later
  FrameFeed feed(live, preparation, Recording(100));
  ASSERT_TRUE(feed.Next()->has_value());
  feed.Stop();
  EXPECT_TRUE(TakeAll(feed).empty());
  FrameFeedOptions here;
  here.in_background = false;
  FrameFeed inline_feed(here, preparation, Recording(100));
  ASSERT_TRUE(inline_feed.Next()->has_value());
  inline_feed.Stop();
  EXPECT_TRUE(TakeAll(inline_feed).empty());
}

TEST(FrameFeed, ErrorsOfReadingAndOfImagesArriveAfterTheFramesBeforeThem) {
  const FramePreparation preparation = MakePreparation();
  for (const bool in_background : {false, true}) {
    for (const bool bad_image : {false, true}) {
      FrameFeedOptions options;
      options.in_background = in_background;
      FrameFeed feed(options, preparation,
                     [&, recording = Recording(5), count = 0]() mutable -> absl::StatusOr<std::optional<RawFrame>> {
                       if (++count < 3) return recording();
                       if (!bad_image) return absl::DataLossError("the disk broke");
                       RawFrame small;
                       small.time_ns = 2000;
                       small.gray = cv::Mat(10, 10, CV_8UC1, cv::Scalar(0));
                       return std::optional<RawFrame>(small);
                     });
      EXPECT_TRUE(feed.Next()->has_value());
      EXPECT_TRUE(feed.Next()->has_value());
      const absl::Status status = feed.Next().status();
      EXPECT_THAT(std::string(status.message()), HasSubstr(bad_image ? "10x10" : "the disk broke"));
    }
  }
}

TEST(FrameFeed, WhatALibraryThrowsEndsTheStreamInOrder) {
  const FramePreparation preparation = MakePreparation();
  for (const bool in_background : {false, true}) {
    FrameFeedOptions options;
    options.in_background = in_background;
    FrameFeed feed(options, preparation,
                   [recording = Recording(5), count = 0]() mutable -> absl::StatusOr<std::optional<RawFrame>> {
                     if (++count < 3) return recording();
                     throw std::bad_alloc();
                   });
    EXPECT_TRUE(feed.Next()->has_value());
    EXPECT_TRUE(feed.Next()->has_value());
    const absl::Status status = feed.Next().status();
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
    EXPECT_THAT(std::string(status.message()), HasSubstr("out of memory"));
  }
}

TEST(FrameFeed, FramesWhoseTimeDoesNotFollowAreLeftOutAndCounted) {
  const FramePreparation preparation = MakePreparation();
  for (const bool in_background : {false, true}) {
    FrameFeedOptions options;
    options.in_background = in_background;
    FrameFeed feed(options, preparation, [recording = Recording(8)]() mutable {
      auto frame = recording();
      if (frame.ok() && frame->has_value()) {
        RawFrame& raw = **frame;
        if (raw.index == 3) raw.time_ns = 1002;                       // as the one before
        if (raw.index == 4) raw.time_ns = 5;                          // back
        if (raw.index == 5) raw.time_ns = 9'000'000'000'000'000'000;  // as from a broken clock
      }
      return frame;
    });
    EXPECT_EQ(TakeAll(feed), (std::vector<std::int64_t>{0, 1, 2, 6, 7}));
    EXPECT_EQ(feed.refused(), 3);
    EXPECT_THAT(std::string(feed.first_refusal().message()), HasSubstr("frame 3"));
  }
}

TEST(FrameFeed, BadOptionsAreRefused) {
  FrameFeedOptions options;
  EXPECT_TRUE(options.Validate().ok());
  options.ahead = 0;
  EXPECT_FALSE(options.Validate().ok());
  options = {};
  options.realtime_speed = -1.0;
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace cairn::engine

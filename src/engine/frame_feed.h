// Brings the frames of a recording to a session: reads and prepares (undistorts) them ahead in a thread of its own, and
// can play the recording like a live camera, which waits for nobody.
//
//   FrameFeed feed(options, preparation, [&] { return source->Next(); });
//   while (auto fed = feed.Next()) session->AddFrame(fed->frame);
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>

#include "base/frame_times.h"
#include "base/status.h"
#include "engine/frame_preparation.h"

namespace cairn::engine {

struct FrameFeedOptions {
  bool in_background = true;  // read and prepare in a thread; always so in real time
  int ahead = 8;              // frames prepared and waiting, if not in real time
  // 0: frames come as fast as they are taken. Otherwise the recording is played at this multiple of its own pace, and a
  // frame that arrives while another one still waits replaces it.
  double realtime_speed = 0.0;
  // In real time: whoever stays away for longer than this, as he waits for a server to come back, is given every frame
  // that came meanwhile, as many as fit into `kept_bytes` (the newest), for up to twice as long as he was away: who has
  // not caught up by then is too slow for the camera. 0: only ever the last one.
  double stall_s = 0.0;
  std::size_t kept_bytes = 256u << 20;

  absl::Status Validate() const;
};

struct FedFrame {
  direct::Frame frame;
  std::chrono::steady_clock::time_point arrival;  // when it had been read; in real time not before it was due
  float prepare_ms = 0.0f;
  std::int64_t dropped_before = 0;  // frames that were replaced since the one that was taken before
};

class FrameFeed {
 public:
  // The next image of the recording, in temporal order; nothing at its end. Called by one thread at a time.
  using Read = std::function<absl::StatusOr<std::optional<RawFrame>>()>;

  // `options` must be valid; `preparation` and what `read` uses must outlive the feed. If no thread can be started, the
  // first Next() says so.
  FrameFeed(const FrameFeedOptions& options, const FramePreparation& preparation, Read read);
  ~FrameFeed();
  FrameFeed(const FrameFeed&) = delete;
  FrameFeed& operator=(const FrameFeed&) = delete;

  // Waits for a frame; nothing at the end of the recording, or after Stop(). Errors of reading and preparing end it,
  // after the frames before them, and so does what `read` throws.
  absl::StatusOr<std::optional<FedFrame>> Next();
  // The recording ends here. From any thread.
  void Stop();

  // Frames that arrived and were replaced by a later one before they were taken.
  std::int64_t dropped() const;
  // Frames left out because their time does not follow that of the frame before (base/frame_times.h), and what was
  // wrong with the first of them.
  std::int64_t refused() const;
  absl::Status first_refusal() const;

 private:
  using Clock = std::chrono::steady_clock;

  // Reads and prepares one frame; nothing at the end.
  absl::StatusOr<std::optional<FedFrame>> Fetch();
  absl::StatusOr<std::optional<RawFrame>> ReadInOrder();
  void Work();
  void End(const absl::Status& status);
  void KeepWithinBounds();            // mutex_ held
  void ForgetAllButTheLast();         // likewise
  void WaitUntilDue(TimeNs time_ns);  // mutex_ not held

  const FrameFeedOptions options_;
  const FramePreparation& preparation_;
  const Read read_;

  // Of the thread that reads.
  std::optional<Clock::time_point> begin_;  // when the first frame was due
  TimeNs first_ns_ = 0;
  FrameTimes times_;

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable changed_;
  std::deque<FedFrame> waiting_;
  std::optional<Clock::time_point> given_;           // when Next() returned the last frame
  std::optional<Clock::time_point> catch_up_until_;  // after a stall, unless nothing waits before
  absl::Status status_;
  bool ended_ = false;    // no more will come
  bool stopped_ = false;  // no more is wanted
  std::int64_t dropped_ = 0;
  std::int64_t dropped_told_ = 0;
  std::int64_t refused_ = 0;
  absl::Status first_refusal_;
  std::thread thread_;
};

}  // namespace cairn::engine

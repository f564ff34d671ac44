// Drives the direct odometry: frames are tracked in the caller's thread, and mapped (points traced, keyframes made and
// optimized) in a thread of their own or, single-threaded, before the call returns.
//
// The hand-over is bounded: a frame waits to be tracked while more than `max_pending` frames wait to be mapped, so that
// the window never lags far behind the poses, and while the keyframe is made that is to bring new points into a view
// that has few.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>

#include "base/frame_times.h"
#include "base/sample_reservoir.h"
#include "base/status.h"
#include "direct/odometry.h"
#include "engine/waiting_reasons.h"

namespace cairn::engine {

struct OdometryRunnerOptions {
  direct::OdometryOptions odometry;
  bool in_background = true;  // map in a thread of its own
  int max_pending = 2;        // frames tracked and not mapped yet

  absl::Status Validate() const;
};

class OdometryRunner {
 public:
  // Called after each mapped frame, and once more at the end, always by the thread that maps: the one place where
  // TakePackets() and PacketOf() may be called. An error ends the run.
  using AfterMapping = std::function<absl::Status(direct::Odometry&)>;

  static absl::StatusOr<std::unique_ptr<OdometryRunner>> Create(const OdometryRunnerOptions& options,
                                                                const Pinhole& camera, AfterMapping after_mapping);
  // Ends the thread; frames that wait are not mapped any more. `after_mapping` must be able to return by then.
  ~OdometryRunner();
  OdometryRunner(const OdometryRunner&) = delete;
  OdometryRunner& operator=(const OdometryRunner&) = delete;

  // The live answer; single-threaded, the best known after mapping. InvalidArgument for a frame that the odometry
  // refuses, or whose time does not follow (base/frame_times.h): nothing has changed then. The error of
  // `after_mapping`, or of a library in the thread that maps, once there was one.
  absl::StatusOr<direct::FrameResult> AddFrame(const direct::Frame& frame);

  // Tells a lost odometry of a view that is known (direct/odometry.h), from any thread; it goes on there with the next
  // frame it maps. Does not wait.
  absl::Status GoOnFrom(direct::KnownView view);

  // Maps what waits, ends the thread, and ends the odometry. Only reading calls after it.
  absl::Status Finish();

  const direct::Odometry& odometry() const { return *odometry_; }
  // What the odometry waited for while it had not started.
  const WaitingReasons& waiting_for() const { return waiting_for_; }
  // Time of the calls of AddFrame(), waiting included, `after_mapping` not.
  const SampleReservoir& frame_ms() const { return frame_ms_; }
  // The last of these calls, kRecentFrames at most: when each began, and its time.
  struct TimedFrame {
    std::chrono::steady_clock::time_point begin;
    float ms = 0.0f;
  };
  static constexpr std::size_t kRecentFrames = 65536;
  const std::deque<TimedFrame>& recent_frames() const { return recent_frames_; }

 private:
  OdometryRunner(const OdometryRunnerOptions& options, std::unique_ptr<direct::Odometry> odometry,
                 AfterMapping after_mapping);
  absl::StatusOr<direct::FrameResult> Process(const direct::Frame& frame);
  void MapInBackground();
  void EndWith(const absl::Status& status);
  absl::Status StopThread(bool drain);

  const OdometryRunnerOptions options_;
  const std::unique_ptr<direct::Odometry> odometry_;
  const AfterMapping after_mapping_;
  WaitingReasons waiting_for_;
  FrameTimes times_;
  SampleReservoir frame_ms_;
  std::deque<TimedFrame> recent_frames_;

  std::mutex mutex_;  // guards what follows
  std::condition_variable work_;
  std::condition_variable room_;
  bool ending_ = false;
  bool drain_ = false;  // when ending: map what waits first
  absl::Status status_;
  std::thread thread_;
};

}  // namespace cairn::engine

// A session of the direct odometry alone: no map, no features, no loops. Takes raw images in temporal order and gives
// the poses of all frames at the end. Tracks in the caller's thread and maps in one of its own, or all in the caller's.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/sample_reservoir.h"
#include "base/status.h"
#include "base/time.h"
#include "direct/odometry.h"
#include "engine/frame_preparation.h"
#include "engine/odometry_runner.h"
#include "engine/session_record.h"

namespace cairn::engine {

struct OdometrySessionOptions {
  bool deterministic = false;  // as threads = 1; the same input gives the same output, to the bit
  int threads = 2;             // 1: everything in the caller's thread; more than 2 are not used
  direct::OdometryOptions odometry;

  absl::Status Validate() const;
};

// The final pose of one frame, in the frame "direct" of its segment: each start of the odometry makes a segment with an
// origin and a scale of its own.
struct DirectFramePose {
  std::int64_t index = 0;
  TimeNs time_ns = 0;
  direct::TrackingState state = direct::TrackingState::kInitializing;
  std::int64_t segment = -1;  // -1: not tracked
  SE3 direct_from_camera;     // if tracked
};

struct OdometryReport {
  std::int64_t frames = 0;
  std::int64_t frames_tracked = 0;  // in all segments
  std::int64_t segments = 0;
  std::int64_t longest_segment = 0;  // with the most frames, the first of them
  std::int64_t longest_segment_frames = 0;
  std::vector<DirectFramePose> frame_poses;
  std::vector<direct::KeyframePose> keyframe_poses;
  SampleReservoir frame_ms;  // per call of AddFrame
  direct::OdometryStatistics odometry;
};

// What the odometry of a runner knows, once it has finished. FailedPrecondition, saying what it waited for, if it never
// started.
absl::StatusOr<OdometryReport> ReportOdometry(const OdometryRunner& runner);

class OdometrySession {
 public:
  static absl::StatusOr<std::unique_ptr<OdometrySession>> Create(const OdometrySessionOptions& options,
                                                                 const SessionSource& source);

  // The live answer. InvalidArgument for an image that does not fit the camera: the frame is skipped, the session goes
  // on.
  absl::StatusOr<direct::FrameResult> AddFrame(const RawFrame& frame);
  // The same, with preparation() done before: by a FrameFeed, which does it ahead.
  absl::StatusOr<direct::FrameResult> AddFrame(const direct::Frame& frame) { return runner_->AddFrame(frame); }
  const FramePreparation& preparation() const { return preparation_; }

  // Ends the stream. FailedPrecondition, saying what the odometry waited for, if it never started.
  absl::StatusOr<OdometryReport> Finish();
  // What is known after Finish(), though it may have returned an error.
  absl::StatusOr<OdometryReport> Report() const;

 private:
  OdometrySession(FramePreparation preparation, std::unique_ptr<OdometryRunner> runner)
      : preparation_(std::move(preparation)), runner_(std::move(runner)) {}

  const FramePreparation preparation_;
  const std::unique_ptr<OdometryRunner> runner_;
};

}  // namespace cairn::engine

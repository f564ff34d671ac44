// A session of the direct odometry alone: no map, no features, no loops. Takes raw images in temporal order and gives
// the poses of all frames at the end.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/status.h"
#include "base/time.h"
#include "direct/odometry.h"
#include "engine/frame_preparation.h"
#include "engine/session_record.h"

namespace cairn::engine {

struct OdometrySessionOptions {
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
  std::vector<float> frame_ms;  // per call of AddFrame
  direct::OdometryStatistics odometry;
};

class OdometrySession {
 public:
  static absl::StatusOr<std::unique_ptr<OdometrySession>> Create(const OdometrySessionOptions& options,
                                                                 const SessionSource& source);

  // The live answer. InvalidArgument for an image that does not fit the camera: the frame is skipped, the session goes
  // on.
  absl::StatusOr<direct::FrameResult> AddFrame(const RawFrame& frame);

  // Ends the stream. FailedPrecondition, saying what the odometry waited for, if it never started.
  absl::StatusOr<OdometryReport> Finish();

 private:
  OdometrySession(FramePreparation preparation, std::unique_ptr<direct::Odometry> odometry)
      : preparation_(std::move(preparation)), odometry_(std::move(odometry)) {}

  const FramePreparation preparation_;
  const std::unique_ptr<direct::Odometry> odometry_;
  std::string waiting_for_;
  std::vector<float> frame_ms_;
};

}  // namespace cairn::engine

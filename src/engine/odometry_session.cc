#include "engine/odometry_session.h"

#include <algorithm>
#include <chrono>
#include <utility>

namespace cairn::engine {

absl::Status OdometrySessionOptions::Validate() const { return odometry.Validate(); }

absl::StatusOr<std::unique_ptr<OdometrySession>> OdometrySession::Create(const OdometrySessionOptions& options,
                                                                         const SessionSource& source) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_ASSIGN_OR_RETURN(FramePreparation preparation, FramePreparation::Create(source));
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<direct::Odometry> odometry,
                         direct::Odometry::Create(options.odometry, preparation.pinhole()));
  return std::unique_ptr<OdometrySession>(new OdometrySession(std::move(preparation), std::move(odometry)));
}

absl::StatusOr<direct::FrameResult> OdometrySession::AddFrame(const RawFrame& raw) {
  const auto start = std::chrono::steady_clock::now();
  CAIRN_ASSIGN_OR_RETURN(const direct::Frame frame, preparation_.Prepare(raw));
  CAIRN_ASSIGN_OR_RETURN(direct::FrameResult result, odometry_->Process(frame));
  odometry_->TakePackets();  // nobody maps them
  frame_ms_.push_back(std::chrono::duration<float, std::milli>(std::chrono::steady_clock::now() - start).count());
  if (result.state == direct::TrackingState::kInitializing && !result.message.empty()) waiting_for_ = result.message;
  return result;
}

absl::StatusOr<OdometryReport> OdometrySession::Finish() {
  odometry_->Finish();
  OdometryReport report;
  report.odometry = odometry_->Statistics();
  report.keyframe_poses = odometry_->KeyframeTrajectory();
  if (report.keyframe_poses.empty()) {
    return absl::FailedPreconditionError(absl::StrCat(
        "the odometry never started: ", waiting_for_.empty() ? "there was no frame to track" : waiting_for_));
  }
  report.segments = report.keyframe_poses.back().segment + 1;
  std::vector<std::int64_t> frames_of(static_cast<std::size_t>(report.segments), 0);
  for (const direct::FrameResult& frame : odometry_->FrameResults()) {
    DirectFramePose pose = {frame.index, frame.time_ns, frame.state, -1, SE3()};
    if (frame.keyframe >= 0) {
      pose.segment = report.keyframe_poses[static_cast<std::size_t>(frame.keyframe)].segment;
      pose.direct_from_camera = frame.direct_from_camera;
      ++frames_of[static_cast<std::size_t>(pose.segment)];
      ++report.frames_tracked;
    }
    report.frame_poses.push_back(pose);
  }
  report.frames = static_cast<std::int64_t>(report.frame_poses.size());
  const auto longest = std::max_element(frames_of.begin(), frames_of.end());
  report.longest_segment = longest - frames_of.begin();
  report.longest_segment_frames = *longest;
  report.frame_ms = frame_ms_;
  return report;
}

}  // namespace cairn::engine

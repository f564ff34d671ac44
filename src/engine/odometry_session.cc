#include "engine/odometry_session.h"

#include <algorithm>
#include <utility>

namespace cairn::engine {

absl::Status OdometrySessionOptions::Validate() const {
  if (threads < 1) return absl::InvalidArgumentError("threads must be at least 1");
  return odometry.Validate();
}

absl::StatusOr<std::unique_ptr<OdometrySession>> OdometrySession::Create(const OdometrySessionOptions& options,
                                                                         const SessionSource& source) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_ASSIGN_OR_RETURN(FramePreparation preparation, FramePreparation::Create(source));
  OdometryRunnerOptions runner_options;
  runner_options.odometry = options.odometry;
  runner_options.in_background = !options.deterministic && options.threads > 1;
  const auto drop_packets = [](direct::Odometry& odometry) {  // nobody maps them
    odometry.TakePackets();
    return absl::OkStatus();
  };
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<OdometryRunner> runner,
                         OdometryRunner::Create(runner_options, preparation.pinhole(), drop_packets));
  return std::unique_ptr<OdometrySession>(new OdometrySession(std::move(preparation), std::move(runner)));
}

absl::StatusOr<direct::FrameResult> OdometrySession::AddFrame(const RawFrame& raw) {
  CAIRN_ASSIGN_OR_RETURN(const direct::Frame frame, preparation_.Prepare(raw));
  return AddFrame(frame);
}

absl::StatusOr<OdometryReport> OdometrySession::Finish() {
  CAIRN_RETURN_IF_ERROR(runner_->Finish());
  return Report();
}

absl::StatusOr<OdometryReport> OdometrySession::Report() const { return ReportOdometry(*runner_); }

absl::StatusOr<OdometryReport> ReportOdometry(const OdometryRunner& runner) {
  const direct::Odometry& odometry = runner.odometry();
  OdometryReport report;
  report.odometry = odometry.Statistics();
  report.keyframe_poses = odometry.KeyframeTrajectory();
  if (report.keyframe_poses.empty()) {
    return absl::FailedPreconditionError(
        absl::StrCat("the odometry never started: ",
                     runner.waiting_for().empty() ? "there was no frame to track" : runner.waiting_for().Describe()));
  }
  report.segments = report.keyframe_poses.back().segment + 1;
  std::vector<std::int64_t> frames_of(static_cast<std::size_t>(report.segments), 0);
  for (const direct::FrameResult& frame : odometry.FrameResults()) {
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
  report.frame_ms = runner.frame_ms();
  return report;
}

}  // namespace cairn::engine

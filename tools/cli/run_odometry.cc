// cairn run --odometry-only: the poses of a sequence's frames by the direct odometry alone.
#include <chrono>
#include <cstdio>

#include "cli/run_options.h"
#include "cli/sample_statistics.h"
#include "engine/odometry_session.h"
#include "io/trajectory.h"

namespace cairn::cli {
namespace {

// Poses of different segments have no common frame: a file holds the longest one.
absl::Status WritePoses(const RunOptions& options, const engine::OdometryReport& report) {
  io::TrajectoryWriteOptions write;
  write.overwrite = options.overwrite;
  write.comment = "t tx ty tz qx qy qz qw: direct_from_camera, scale arbitrary";
  if (report.segments > 1) {
    absl::StrAppend(&write.comment, ", segment ", report.longest_segment + 1, " of ", report.segments);
  }
  if (!options.trajectory.empty()) {
    std::vector<io::StampedPose> poses;
    for (const engine::DirectFramePose& frame : report.frame_poses) {
      if (frame.segment == report.longest_segment) poses.push_back({frame.time_ns, frame.direct_from_camera});
    }
    CAIRN_RETURN_IF_ERROR(io::WriteTumTrajectory(options.trajectory, poses, write));
  }
  if (!options.keyframes.empty()) {
    std::vector<io::StampedPose> poses;
    for (const direct::KeyframePose& keyframe : report.keyframe_poses) {
      if (keyframe.segment == report.longest_segment) poses.push_back({keyframe.time_ns, keyframe.direct_from_camera});
    }
    CAIRN_RETURN_IF_ERROR(io::WriteTumTrajectory(options.keyframes, poses, write));
  }
  return absl::OkStatus();
}

void PrintReport(const RunOptions& options, const engine::OdometryReport& report, const io::SourceInfo& info,
                 std::int64_t skipped, double elapsed_s) {
  const auto keyframes = static_cast<long long>(report.keyframe_poses.size());
  const double total = static_cast<double>(info.num_frames);
  const double tracked_share = total > 0.0 ? static_cast<double>(report.frames_tracked) / total : 0.0;
  const double speed = elapsed_s > 0.0 ? info.duration_s / elapsed_s : 0.0;
  if (options.json) {
    PrintJson({{"frames", info.num_frames},
               {"frames_tracked", report.frames_tracked},
               {"tracked_share", tracked_share},
               {"frames_skipped", skipped},
               {"direct_keyframes", keyframes},
               {"segments", report.segments},
               {"trajectory_segment", report.longest_segment + 1},
               {"trajectory_frames", report.longest_segment_frames},
               {"elapsed_s", elapsed_s},
               {"duration_s", info.duration_s},
               {"realtime_factor", speed},
               {"frame_ms", SampleStatistics(report.frame_ms)},
               {"track_ms", SampleStatistics(report.odometry.track.samples_ms)}});
    return;
  }
  std::printf("tracked %lld of %lld frames (%.1f %%) in %.1f s, %.1f x real time; %lld keyframes\n",
              static_cast<long long>(report.frames_tracked), static_cast<long long>(info.num_frames),
              100.0 * tracked_share, elapsed_s, speed, keyframes);
  std::printf("  per frame %.2f ms median, %.2f ms mean; tracking alone %.2f ms median, %.2f ms mean\n",
              Percentile(report.frame_ms, 0.5), Mean(report.frame_ms),
              Percentile(report.odometry.track.samples_ms, 0.5), Mean(report.odometry.track.samples_ms));
  if (skipped > 0) std::printf("  %lld images could not be used\n", static_cast<long long>(skipped));
  if (report.segments > 1) {
    std::printf(
        "  tracking was lost and started anew: %lld segments, each with an origin and a scale of its own;\n"
        "  files hold the longest, segment %lld with %lld frames\n",
        static_cast<long long>(report.segments), static_cast<long long>(report.longest_segment + 1),
        static_cast<long long>(report.longest_segment_frames));
  }
}

}  // namespace

absl::Status TrackSequence(const RunOptions& options) {
  for (const std::string* output : {&options.trajectory, &options.keyframes}) {
    CAIRN_RETURN_IF_ERROR(CheckWritable(*output, options.overwrite));
  }
  CAIRN_RETURN_IF_ERROR(CheckDistinct({options.trajectory, options.keyframes}, {options.input.open.camera_path}));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<io::FrameSource> source, OpenInput(options.input));
  const io::SourceInfo& info = source->info();
  engine::OdometrySessionOptions session_options;
  session_options.odometry = options.session.odometry;
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<engine::OdometrySession> session,
                         engine::OdometrySession::Create(session_options, ToSessionSource(info)));
  const auto start = std::chrono::steady_clock::now();
  SkippedFrames skipped("run", options.json);
  Progress progress("tracking", info.num_frames, options.json);
  const absl::Status read =
      ForEachFrame(*source, &skipped, &progress, [&](const io::SourceFrame& frame) -> absl::StatusOr<std::string> {
        CAIRN_ASSIGN_OR_RETURN(const direct::FrameResult result, session->AddFrame(ToRaw(frame)));
        return result.message;
      });
  CAIRN_RETURN_IF_ERROR(read);
  CAIRN_ASSIGN_OR_RETURN(const engine::OdometryReport report, session->Finish());
  progress.Finish();
  const double elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  CAIRN_RETURN_IF_ERROR(WritePoses(options, report));
  PrintReport(options, report, info, skipped.count(), elapsed_s);
  return absl::OkStatus();
}

}  // namespace cairn::cli

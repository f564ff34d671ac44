// cairn run --odometry-only: the poses of a sequence's frames by the direct odometry alone.
#include <cstdio>

#include "absl/strings/str_format.h"
#include "base/guarded.h"
#include "cli/run_options.h"
#include "cli/sample_statistics.h"
#include "engine/odometry_session.h"
#include "io/trajectory.h"
#include "text/text.h"

namespace cairn::cli {

absl::Status WriteOdometryPoses(const RunOptions& options, const engine::OdometryReport& report) {
  io::TrajectoryWriteOptions write;
  write.overwrite = options.overwrite;
  write.comment = "t tx ty tz qx qy qz qw: direct_from_camera, scale arbitrary";
  if (report.segments > 1) {
    absl::StrAppend(&write.comment, ", segment ", report.longest_segment + 1, " of ", report.segments);
  }
  absl::Status status;
  if (!options.trajectory.empty()) {
    std::vector<io::StampedPose> poses;
    for (const engine::DirectFramePose& frame : report.frame_poses) {
      if (frame.segment == report.longest_segment) poses.push_back({frame.time_ns, frame.direct_from_camera});
    }
    status.Update(io::WriteTumTrajectory(options.trajectory, poses, write));
  }
  if (!options.keyframes.empty()) {
    std::vector<io::StampedPose> poses;
    for (const direct::KeyframePose& keyframe : report.keyframe_poses) {
      if (keyframe.segment == report.longest_segment) poses.push_back({keyframe.time_ns, keyframe.direct_from_camera});
    }
    status.Update(io::WriteTumTrajectory(options.keyframes, poses, write));
  }
  return status;
}

namespace {

void PrintReport(const RunOptions& options, const engine::OdometryReport& report, const io::SourceInfo& info,
                 const FeedReport& feed, const InterruptWatch& interrupt) {
  const auto keyframes = static_cast<long long>(report.keyframe_poses.size());
  if (options.json) {
    nlohmann::ordered_json json;
    AddFeedJson(feed, info, report.frames_tracked, interrupt, &json);
    json.update({{"direct_keyframes", keyframes},
                 {"segments", report.segments},
                 {"frame", "direct"},
                 {"unit", "of the segment: its scale is arbitrary"},
                 {"trajectory_segment", report.longest_segment + 1},
                 {"trajectory_frames", report.longest_segment_frames},
                 {"frame_ms", SampleStatistics(report.frame_ms)},
                 {"track_ms", SampleStatistics(report.odometry.track.samples_ms)}});
    PrintJson(json);
    return;
  }
  text::Say(absl::StrFormat("%s: %lld keyframes of the odometry\n", info.name, keyframes));
  PrintFeed(feed, info, report.frames_tracked, interrupt);
  text::Say(absl::StrFormat("  per frame %.2f ms median, %.2f ms mean; tracking alone %.2f ms median, %.2f ms mean\n",
                            report.frame_ms.Percentile(0.5), report.frame_ms.mean(),
                            report.odometry.track.samples_ms.Percentile(0.5), report.odometry.track.samples_ms.mean()));
  if (report.segments > 1) {
    text::Say(absl::StrFormat(
        "  tracking was lost and started anew: %lld segments, each with an origin and a scale of its own;\n"
        "  files hold the longest, segment %lld with %lld frames\n",
        static_cast<long long>(report.segments), static_cast<long long>(report.longest_segment + 1),
        static_cast<long long>(report.longest_segment_frames)));
  }
}

}  // namespace

absl::Status TrackSequence(const RunOptions& options, InterruptWatch* interrupt) {
  for (const std::string* output : {&options.trajectory, &options.keyframes}) {
    CAIRN_RETURN_IF_ERROR(CheckWritable(*output, options.overwrite));
  }
  CAIRN_RETURN_IF_ERROR(CheckDistinct({options.trajectory, options.keyframes}, InputFiles(options.input)));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<io::FrameSource> source, OpenRunInput(options));
  engine::OdometrySessionOptions session_options;
  session_options.deterministic = options.session.deterministic;
  if (options.threads > 0) session_options.threads = options.threads;
  session_options.odometry = options.session.odometry;
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<engine::OdometrySession> session,
                         engine::OdometrySession::Create(session_options, ToSessionSource(source->info())));
  engine::OdometryReport report;
  const auto add = [&](const engine::FedFrame& fed) -> absl::StatusOr<std::string> {
    const direct::Frame& frame = fed.frame;
    CAIRN_ASSIGN_OR_RETURN(const direct::FrameResult result, session->AddFrame(frame));
    return result.message;
  };
  const auto finish = [&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(report, session->Finish());
    return absl::OkStatus();
  };
  const absl::StatusOr<FeedReport> feed =
      FeedSequence(ToFeedSettings(options, "tracking"), source.get(), session->preparation(), interrupt, add, finish);
  if (!feed.ok()) {  // what was tracked until then is known nevertheless
    session->Finish().IgnoreError();
    const absl::StatusOr<engine::OdometryReport> until_then = Guarded([&] { return session->Report(); });
    if (!until_then.ok()) return feed.status();
    return AfterError(feed.status(), {options.trajectory, options.keyframes},
                      Guarded([&] { return WriteOdometryPoses(options, *until_then); }));
  }
  CAIRN_RETURN_IF_ERROR(WriteOdometryPoses(options, report));
  PrintReport(options, report, source->info(), *feed, *interrupt);
  return absl::OkStatus();
}

}  // namespace cairn::cli

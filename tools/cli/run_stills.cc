// cairn run --map --poses: stills whose poses are known become a map, without odometry.
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <optional>

#include "base/guarded.h"
#include "cli/run_options.h"
#include "engine/posed_session.h"
#include "io/trajectory.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

// The given pose of each image, within half a millisecond-scale tolerance of its time.
const io::StampedPose* PoseAt(const std::vector<io::StampedPose>& poses, TimeNs time_ns) {
  constexpr TimeNs kTolerance_ns = 1'000'000;
  auto at = std::lower_bound(poses.begin(), poses.end(), time_ns - kTolerance_ns,
                             [](const io::StampedPose& pose, TimeNs time) { return pose.time_ns < time; });
  return at != poses.end() && at->time_ns <= time_ns + kTolerance_ns ? &*at : nullptr;
}

}  // namespace

absl::Status MapStills(const RunOptions& options, InterruptWatch* interrupt) {
  CAIRN_ASSIGN_OR_RETURN(io::Trajectory given, io::ReadTrajectory(options.poses));
  TellNotes("run", given.notes);
  std::sort(given.poses.begin(), given.poses.end(), [](const auto& a, const auto& b) { return a.time_ns < b.time_ns; });
  CAIRN_ASSIGN_OR_RETURN(MapRun run, PrepareMapRun(options));
  const io::SourceInfo info = run.source->info();
  CAIRN_ASSIGN_OR_RETURN(
      std::unique_ptr<engine::PosedSession> session,
      engine::PosedSession::Create(options.posed, options.session.deterministic, run.session_source, run.map.get()));
  SkippedFrames skipped("run", options.json);
  Progress progress("mapping", info.num_frames, options.json);
  std::int64_t used = 0;
  std::atomic<bool> stop = false;
  {
    const InterruptWatch::Guard guard(interrupt, [&] { stop = true; });
    while (!stop) {
      CAIRN_ASSIGN_OR_RETURN(const std::optional<io::SourceFrame> frame, run.source->Next());
      if (!frame) break;
      const io::StampedPose* pose = PoseAt(given.poses, frame->time_ns);
      if (!frame->status.ok()) {
        skipped.Add(frame->path, frame->status);
      } else if (pose == nullptr) {
        skipped.Add(frame->path, absl::NotFoundError(absl::StrCat("no pose for it in ", options.poses)));
      } else {
        const absl::Status added = Guarded([&] { return session->AddFrame(ToRaw(*frame), pose->world_from_camera); });
        if (absl::IsInvalidArgument(added)) {
          skipped.Add(frame->path, added);
        } else {
          CAIRN_RETURN_IF_ERROR(added);
          ++used;
        }
      }
      progress.Update(frame->index + 1);
    }
  }
  progress.Finish();
  CAIRN_ASSIGN_OR_RETURN(const mapping::PosedMapperReport report, session->Finish());
  const absl::Status closed = run.map->Close();
  const std::shared_ptr<const map::Snapshot> map = run.map->Published()->snapshot();
  const absl::Status written =
      WriteMapOutputs(options, *map, session->component(), MapKeyframePoses(*map, session->component()));
  if (!closed.ok()) return AfterError(closed, {options.trajectory, options.keyframes, options.picture}, written);
  CAIRN_RETURN_IF_ERROR(written);
  if (options.json) {
    PrintJson({{"map", options.map},
               {"frame", "world"},
               {"unit", "m"},
               {"frames", info.num_frames},
               {"frames_used", used},
               {"frames_skipped", skipped.count()},
               {"interrupted", interrupt->exit_code() != 0},
               {"keyframes", report.keyframes},
               {"points", report.points},
               {"observations", report.observations},
               {"rmse_px", report.rmse_px},
               {"poses_fit_share", report.fit.share},
               {"images_found_in_map", report.found_in_map},
               {"poses_inverted_fit_share", report.fit.inverted_share}});
  } else {
    std::printf("%s: %d keyframes with given poses, %d points, reprojection %.2f px RMSE (per axis, as at octave 0)\n",
                text::Shown(options.map).c_str(), report.keyframes, report.points, report.rmse_px);
    std::printf("  the given poses explain %.0f %% of %d matches between %d pairs of images\n",
                100.0 * report.fit.share, report.fit.matches, report.fit.pairs);
    if (report.found_in_map > 0)
      std::printf("  %d images were found in the map, where they are\n", report.found_in_map);
    if (skipped.count() > 0) std::printf("  %lld images could not be used\n", static_cast<long long>(skipped.count()));
    if (interrupt->exit_code() != 0) std::printf("  interrupted: the map holds the images up to there\n");
  }
  return absl::OkStatus();
}

}  // namespace cairn::cli

// cairn run --map: maps a sequence into a map file.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>

#include "base/version.h"
#include "cli/pictures.h"
#include "cli/run_options.h"
#include "cli/sample_statistics.h"
#include "io/trajectory.h"
#include "place/default_vocabulary.h"

namespace cairn::cli {
namespace {

std::vector<io::StampedPose> InWorld(const std::vector<std::pair<TimeNs, SE3>>& poses, const map::Snapshot& map) {
  const Sim3 world_from_map = map.info().world_from_map.value_or(Sim3());
  std::vector<io::StampedPose> result;
  for (const auto& [time_ns, map_from_camera] : poses) {
    result.push_back({time_ns, world_from_map.TransformPose(map_from_camera)});
  }
  return result;
}

absl::Status WritePoses(const std::string& path, const std::vector<std::pair<TimeNs, SE3>>& poses,
                        const map::Snapshot& map, bool overwrite) {
  if (path.empty()) return absl::OkStatus();
  io::TrajectoryWriteOptions write;
  write.overwrite = overwrite;
  write.comment = absl::StrCat("t tx ty tz qx qy qz qw: ", map.info().world_from_map ? "world" : "map",
                               "_from_camera, map ", map.info().id, " revision ", map.revision());
  return io::WriteTumTrajectory(path, InWorld(poses, map), write);
}

void PrintReport(const RunOptions& options, const engine::SessionReport& report, const io::SourceInfo& info,
                 std::int64_t skipped, double elapsed_s) {
  const double total = static_cast<double>(info.num_frames);
  const double tracked_share = total > 0.0 ? static_cast<double>(report.frames_tracked) / total : 0.0;
  const double speed = elapsed_s > 0.0 ? info.duration_s / elapsed_s : 0.0;
  if (options.json) {
    PrintJson({{"map", options.map},
               {"frames", info.num_frames},
               {"frames_tracked", report.frames_tracked},
               {"tracked_share", tracked_share},
               {"frames_skipped", skipped},
               {"direct_keyframes", report.direct_keyframes},
               {"keyframes", report.keyframes},
               {"points", report.points},
               {"segments", report.odometry.segments},
               {"feature_losses", report.feature_losses},
               {"elapsed_s", elapsed_s},
               {"duration_s", info.duration_s},
               {"realtime_factor", speed},
               {"frame_ms", SampleStatistics(report.frame_ms)},
               {"track_ms", SampleStatistics(report.odometry.track.samples_ms)},
               {"keyframe_ms", SampleStatistics(report.keyframe_ms)}});
    return;
  }
  std::printf("%s: %lld keyframes, %lld points\n", options.map.c_str(), static_cast<long long>(report.keyframes),
              static_cast<long long>(report.points));
  std::printf("  tracked %lld of %lld frames (%.1f %%) in %.1f s, %.1f x real time\n",
              static_cast<long long>(report.frames_tracked), static_cast<long long>(info.num_frames),
              100.0 * tracked_share, elapsed_s, speed);
  std::printf("  per frame %.2f ms median, %.2f ms mean; per keyframe %.0f ms median in the feature module\n",
              Percentile(report.frame_ms, 0.5), Mean(report.frame_ms), Percentile(report.keyframe_ms, 0.5));
  if (skipped > 0) std::printf("  %lld images could not be used\n", static_cast<long long>(skipped));
  if (report.feature_losses > 0) {
    std::printf("  the feature map was lost %lld times; the odometry bridged it\n",
                static_cast<long long>(report.feature_losses));
  }
}

}  // namespace

engine::RawFrame ToRaw(const io::SourceFrame& frame) {
  return {frame.sequence_index, frame.time_ns, frame.gray, frame.exposure_s};
}

engine::SessionSource ToSessionSource(const io::SourceInfo& info) {
  engine::SessionSource source;
  source.name = info.name;
  source.camera = info.camera;
  source.photometric = info.photometric;
  source.first_ns = info.first_time_ns;
  return source;
}

absl::StatusOr<MapRun> PrepareMapRun(const RunOptions& options) {
  for (const std::string* output : {&options.trajectory, &options.keyframes, &options.picture}) {
    CAIRN_RETURN_IF_ERROR(CheckWritable(*output, options.overwrite));
  }
  CAIRN_RETURN_IF_ERROR(CheckWritable(options.map, options.overwrite));
  CAIRN_RETURN_IF_ERROR(CheckDistinct({options.map, options.trajectory, options.keyframes, options.picture},
                                      {options.input.open.camera_path, options.poses, options.vocabulary}));
  CAIRN_RETURN_IF_ERROR(CheckPicture(options.picture));
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<io::FrameSource> source, OpenInput(options.input));
  CAIRN_ASSIGN_OR_RETURN(place::Vocabulary vocabulary, options.vocabulary.empty()
                                                           ? place::LoadDefaultVocabulary()
                                                           : place::Vocabulary::Load(options.vocabulary));
  const io::SourceInfo& info = source->info();
  map::MapInfo map_info;
  const bool deterministic = options.session.deterministic;
  map_info.id =
      engine::NewMapId(deterministic ? std::optional(absl::StrCat(info.name, info.first_time_ns)) : std::nullopt);
  map_info.name = options.name.empty() ? info.name : options.name;
  map_info.software_version = cairn::kVersion;
  map_info.created_unix_ns = deterministic ? 0 : engine::UnixNowNs();
  map_info.vocabulary_hash = vocabulary.hash();
  if (!options.poses.empty()) map_info.world_from_map = Sim3();
  CAIRN_ASSIGN_OR_RETURN(
      std::unique_ptr<engine::MapWriter> writer,
      engine::MapWriter::Create(options.map, map_info, {options.overwrite, vocabulary.Serialize(), !deterministic}));
  engine::SessionSource session_source = ToSessionSource(info);
  const nlohmann::ordered_json settings = {
      {"format", std::string(io::SequenceFormatName(info.format))},
      {"from_s", options.input.open.from_s},
      {"until_s",
       std::isfinite(options.input.open.until_s) ? nlohmann::ordered_json(options.input.open.until_s) : nullptr},
      {"stride", options.input.open.stride},
      {"deterministic", deterministic},
      {"full_resolution", options.session.odometry.full_resolution},
      {"poses_given", !options.poses.empty()}};
  session_source.settings_json = settings.dump();
  return MapRun{std::move(source), std::move(vocabulary), std::move(writer), std::move(session_source)};
}

std::vector<std::pair<TimeNs, SE3>> MapKeyframePoses(const map::Snapshot& map) {
  std::vector<std::pair<TimeNs, SE3>> poses;
  map.keyframes().ForEach(
      [&](const auto& keyframe) { poses.emplace_back(keyframe->time_ns, keyframe->camera_from_map.Inverse()); });
  std::sort(poses.begin(), poses.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  return poses;
}

absl::Status WriteMapOutputs(const RunOptions& options, const map::Snapshot& map,
                             const std::vector<std::pair<TimeNs, SE3>>& frame_poses) {
  CAIRN_RETURN_IF_ERROR(WritePoses(options.trajectory, frame_poses, map, options.overwrite));
  CAIRN_RETURN_IF_ERROR(WritePoses(options.keyframes, MapKeyframePoses(map), map, options.overwrite));
  return options.picture.empty() ? absl::OkStatus() : DrawMap(map, options.picture);
}

absl::Status MapSequence(const RunOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(MapRun run, PrepareMapRun(options));
  const io::SourceInfo info = run.source->info();
  CAIRN_ASSIGN_OR_RETURN(
      std::unique_ptr<engine::Session> session,
      engine::Session::Create(options.session, run.session_source, &run.vocabulary, run.writer.get()));
  const auto start = std::chrono::steady_clock::now();
  SkippedFrames skipped("run", options.json);
  Progress progress("mapping", info.num_frames, options.json);
  const absl::Status read =
      ForEachFrame(*run.source, &skipped, &progress, [&](const io::SourceFrame& frame) -> absl::StatusOr<std::string> {
        CAIRN_ASSIGN_OR_RETURN(const direct::FrameResult result, session->AddFrame(ToRaw(frame)));
        const bool waits = result.state == direct::TrackingState::kInitializing;
        return waits ? result.message : absl::StrCat(session->KeyframesInMap(), " keyframes");
      });
  CAIRN_RETURN_IF_ERROR(read);
  CAIRN_ASSIGN_OR_RETURN(const engine::SessionReport report, session->Finish());
  progress.Finish();
  const double elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  std::vector<std::pair<TimeNs, SE3>> frame_poses;
  for (const engine::FramePose& frame : report.frame_poses) {
    if (frame.map_from_camera) frame_poses.emplace_back(frame.time_ns, *frame.map_from_camera);
  }
  CAIRN_RETURN_IF_ERROR(run.writer->Close());
  CAIRN_RETURN_IF_ERROR(WriteMapOutputs(options, *run.writer->Current(), frame_poses));
  PrintReport(options, report, info, skipped.count(), elapsed_s);
  return absl::OkStatus();
}

}  // namespace cairn::cli

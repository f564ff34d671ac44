// cairn run: maps a sequence into a map file.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <iostream>

#include "base/version.h"
#include "cli/cli.h"
#include "cli/input_options.h"
#include "cli/pictures.h"
#include "cli/sample_statistics.h"
#include "engine/posed_session.h"
#include "engine/session.h"
#include "io/trajectory.h"
#include "place/default_vocabulary.h"

namespace cairn::cli {
namespace {

struct RunOptions {
  InputOptions input;
  std::string map;
  std::string name;
  std::string trajectory;
  std::string keyframes;
  std::string poses;
  std::string vocabulary;
  std::string picture;
  engine::SessionOptions session;
  mapping::PosedMapperOptions posed;
  bool overwrite = false;
  bool json = false;
};

struct Prepared {
  std::unique_ptr<io::FrameSource> source;
  place::Vocabulary vocabulary;
  std::unique_ptr<engine::MapWriter> writer;
  engine::SessionSource session_source;
};

absl::StatusOr<Prepared> Prepare(const RunOptions& options) {
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
  engine::SessionSource session_source;
  session_source.name = info.name;
  session_source.camera = info.camera;
  session_source.photometric = info.photometric;
  session_source.first_ns = info.first_time_ns;
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
  return Prepared{std::move(source), std::move(vocabulary), std::move(writer), std::move(session_source)};
}

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

std::vector<std::pair<TimeNs, SE3>> MapKeyframePoses(const map::Snapshot& map) {
  std::vector<std::pair<TimeNs, SE3>> poses;
  map.keyframes().ForEach(
      [&](const auto& keyframe) { poses.emplace_back(keyframe->time_ns, keyframe->camera_from_map.Inverse()); });
  std::sort(poses.begin(), poses.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  return poses;
}

absl::Status WriteOutputs(const RunOptions& options, const map::Snapshot& map,
                          const std::vector<std::pair<TimeNs, SE3>>& frame_poses) {
  CAIRN_RETURN_IF_ERROR(WritePoses(options.trajectory, frame_poses, map, options.overwrite));
  CAIRN_RETURN_IF_ERROR(WritePoses(options.keyframes, MapKeyframePoses(map), map, options.overwrite));
  return options.picture.empty() ? absl::OkStatus() : DrawMap(map, options.picture);
}

// From files to frames: reads, skips what is damaged, shows the progress.
template <class Handle>
absl::Status ForEachFrame(io::FrameSource& source, SkippedFrames* skipped, Progress* progress, const Handle& handle) {
  for (;;) {
    CAIRN_ASSIGN_OR_RETURN(std::optional<io::SourceFrame> frame, source.Next());
    if (!frame) return absl::OkStatus();
    if (!frame->status.ok()) {
      skipped->Add(frame->path, frame->status);
      continue;
    }
    CAIRN_ASSIGN_OR_RETURN(const std::string note, handle(*frame));
    progress->Update(frame->index + 1, note);
  }
}

engine::RawFrame ToRaw(const io::SourceFrame& frame) {
  return {frame.sequence_index, frame.time_ns, frame.gray, frame.exposure_s};
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

absl::Status MapSequence(const RunOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(Prepared prepared, Prepare(options));
  const io::SourceInfo info = prepared.source->info();
  CAIRN_ASSIGN_OR_RETURN(
      std::unique_ptr<engine::Session> session,
      engine::Session::Create(options.session, prepared.session_source, &prepared.vocabulary, prepared.writer.get()));
  const auto start = std::chrono::steady_clock::now();
  SkippedFrames skipped("run", options.json);
  Progress progress("mapping", info.num_frames, options.json);
  const absl::Status read = ForEachFrame(
      *prepared.source, &skipped, &progress, [&](const io::SourceFrame& frame) -> absl::StatusOr<std::string> {
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
  CAIRN_RETURN_IF_ERROR(prepared.writer->Close());
  CAIRN_RETURN_IF_ERROR(WriteOutputs(options, *prepared.writer->Current(), frame_poses));
  PrintReport(options, report, info, skipped.count(), elapsed_s);
  return absl::OkStatus();
}

// The given pose of each image, within half a millisecond-scale tolerance of its time.
const io::StampedPose* PoseAt(const std::vector<io::StampedPose>& poses, TimeNs time_ns) {
  constexpr TimeNs kTolerance_ns = 1'000'000;
  auto at = std::lower_bound(poses.begin(), poses.end(), time_ns - kTolerance_ns,
                             [](const io::StampedPose& pose, TimeNs time) { return pose.time_ns < time; });
  return at != poses.end() && at->time_ns <= time_ns + kTolerance_ns ? &*at : nullptr;
}

absl::Status MapStills(const RunOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(io::Trajectory given, io::ReadTrajectory(options.poses));
  std::sort(given.poses.begin(), given.poses.end(), [](const auto& a, const auto& b) { return a.time_ns < b.time_ns; });
  CAIRN_ASSIGN_OR_RETURN(Prepared prepared, Prepare(options));
  const io::SourceInfo info = prepared.source->info();
  CAIRN_ASSIGN_OR_RETURN(
      std::unique_ptr<engine::PosedSession> session,
      engine::PosedSession::Create(options.posed, options.session.deterministic, prepared.session_source,
                                   &prepared.vocabulary, prepared.writer.get()));
  SkippedFrames skipped("run", options.json);
  Progress progress("mapping", info.num_frames, options.json);
  std::int64_t used = 0;
  const absl::Status read = ForEachFrame(
      *prepared.source, &skipped, &progress, [&](const io::SourceFrame& frame) -> absl::StatusOr<std::string> {
        const io::StampedPose* pose = PoseAt(given.poses, frame.time_ns);
        if (pose == nullptr) {
          skipped.Add(frame.path, absl::NotFoundError(absl::StrCat("no pose for it in ", options.poses)));
          return std::string();
        }
        CAIRN_RETURN_IF_ERROR(session->AddFrame(ToRaw(frame), pose->world_from_camera));
        ++used;
        return std::string();
      });
  CAIRN_RETURN_IF_ERROR(read);
  progress.Finish();
  CAIRN_ASSIGN_OR_RETURN(const mapping::PosedMapperReport report, session->Finish());
  CAIRN_RETURN_IF_ERROR(prepared.writer->Close());
  const std::shared_ptr<const map::Snapshot> map = prepared.writer->Current();
  CAIRN_RETURN_IF_ERROR(WriteOutputs(options, *map, MapKeyframePoses(*map)));
  if (options.json) {
    PrintJson({{"map", options.map},
               {"frames", info.num_frames},
               {"frames_used", used},
               {"frames_skipped", skipped.count()},
               {"keyframes", report.keyframes},
               {"points", report.points},
               {"observations", report.observations},
               {"rmse_px", report.rmse_px}});
  } else {
    std::printf("%s: %d keyframes with given poses, %d points, reprojection %.2f px RMSE\n", options.map.c_str(),
                report.keyframes, report.points, report.rmse_px);
    if (skipped.count() > 0) std::printf("  %lld images could not be used\n", static_cast<long long>(skipped.count()));
  }
  return absl::OkStatus();
}

int Run(const RunOptions& options) {
  const absl::Status status = options.poses.empty() ? MapSequence(options) : MapStills(options);
  return status.ok() ? kOk : Fail("run", status, options.json);
}

}  // namespace

void AddRunCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("run", "Map a sequence into a map file");
  auto options = std::make_shared<RunOptions>();
  AddInputOptions(verb, &options->input);
  verb->add_option("--map", options->map, "The map file to write (.cairn)")->required();
  verb->add_option("--name", options->name, "Name of the map; the sequence's if not given");
  verb->add_option("--trajectory", options->trajectory,
                   "Write the final pose of every frame to this file (TUM format)");
  verb->add_option("--keyframes", options->keyframes,
                   "Write the poses of the map's keyframes to this file (TUM format)");
  verb->add_option("--poses", options->poses, "Known camera poses of still images: maps them without odometry");
  verb->add_option("--vocabulary", options->vocabulary, "Vocabulary file; the one that comes with Cairn if not given");
  verb->add_option("--picture", options->picture, "Draw the map from above to this .png or .svg file");
  verb->add_flag("--deterministic", options->session.deterministic,
                 "One thread, fixed order: two runs give identical output");
  verb->add_flag("--full-resolution", options->session.odometry.full_resolution,
                 "Track on full instead of half resolution: slower");
  verb->add_flag("--overwrite", options->overwrite, "Replace files that exist");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "Examples:\n"
      "  cairn run rgbd_dataset --camera camera.yaml --map office.cairn\n"
      "  cairn run MH_01_easy --map hall.cairn --until 60 --trajectory frames.txt\n"
      "  cairn run stills --poses poses.txt --map stills.cairn");
  verb->callback([=] { *action = [=] { return Run(*options); }; });
}

}  // namespace cairn::cli

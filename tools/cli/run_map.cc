// cairn run --map: maps a sequence into a map file.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <optional>

#include "base/files.h"
#include "base/guarded.h"
#include "base/version.h"
#include "cli/live_pose_file.h"
#include "cli/map_run_report.h"
#include "cli/pictures.h"
#include "cli/run_options.h"
#include "cli/where_watch.h"
#include "io/trajectory.h"
#include "place/default_vocabulary.h"

namespace cairn::cli {
namespace {

std::vector<io::StampedPose> InWorld(const std::vector<std::pair<TimeNs, SE3>>& poses, const Sim3& world_from_map) {
  std::vector<io::StampedPose> result;
  for (const auto& [time_ns, map_from_camera] : poses) {
    result.push_back({time_ns, world_from_map.TransformPose(map_from_camera)});
  }
  return result;
}

absl::Status WritePoses(const std::string& path, const std::vector<std::pair<TimeNs, SE3>>& poses,
                        const map::Snapshot& map, ComponentId component, bool overwrite) {
  if (path.empty()) return absl::OkStatus();
  const bool aligned = component && map.WorldFrom(component).has_value();
  const Sim3 world_from_map = aligned ? *map.WorldFrom(component) : Sim3();
  io::TrajectoryWriteOptions write;
  write.overwrite = overwrite;
  write.comment = absl::StrCat("t tx ty tz qx qy qz qw: ", aligned ? "world" : "map", "_from_camera, map ",
                               map.info().id, " component ", component.value(), " revision ", map.revision());
  return io::WriteTumTrajectory(path, InWorld(poses, world_from_map), write);
}

// The map must be there to be extended, and must not be to be made.
absl::Status CheckMap(const RunOptions& options) {
  std::error_code error;
  const bool exists = std::filesystem::exists(options.map, error);
  if (options.extend) {
    return exists ? absl::OkStatus()
                  : absl::NotFoundError(
                        absl::StrCat("there is no map ", options.map, " to extend: leave --extend out to make it"));
  }
  if (exists && !options.overwrite && WhyNoFile(options.map).empty()) {
    return absl::AlreadyExistsError(absl::StrCat(options.map,
                                                 " exists already: give --extend to add this session to it, "
                                                 "--overwrite to replace it, or choose another name"));
  }
  return CheckWritable(options.map, options.overwrite, /*is_map=*/true);
}

absl::StatusOr<std::unique_ptr<engine::LiveMap>> OpenToExtend(const RunOptions& options) {
  store::WriteOptions write;
  write.record_wall_clock = !options.session.deterministic;
  return engine::LiveMap::Open(options.map, write);
}

absl::StatusOr<std::unique_ptr<engine::LiveMap>> CreateMap(const RunOptions& options, const io::SourceInfo& info,
                                                           const std::string& settings) {
  const bool deterministic = options.session.deterministic;
  CAIRN_ASSIGN_OR_RETURN(place::Vocabulary vocabulary, options.vocabulary.empty()
                                                           ? place::LoadDefaultVocabulary()
                                                           : place::Vocabulary::Load(options.vocabulary));
  map::MapInfo map_info;
  // The same run makes the same map, another one a map of its own.
  map_info.id =
      engine::NewMapId(deterministic ? std::optional(absl::StrCat(info.name, info.first_time_ns, info.camera.Describe(),
                                                                  settings, absl::Hex(vocabulary.hash())))
                                     : std::nullopt);
  map_info.name = options.name.empty() ? info.name : options.name;
  map_info.software_version = cairn::kVersion;
  map_info.created_unix_ns = deterministic ? 0 : engine::UnixNowNs();
  map_info.vocabulary_hash = vocabulary.hash();
  store::CreateOptions create;
  create.overwrite = options.overwrite;
  create.write.record_wall_clock = !deterministic;
  return engine::LiveMap::Create(options.map, map_info,
                                 std::make_shared<const place::Vocabulary>(std::move(vocabulary)), std::move(create));
}

}  // namespace

absl::StatusOr<MapRun> PrepareMapRun(const RunOptions& options) {
  for (const std::string* output : {&options.trajectory, &options.quality, &options.keyframes, &options.picture}) {
    CAIRN_RETURN_IF_ERROR(CheckWritable(*output, options.overwrite));
  }
  // Somebody may follow the live poses through a pipe.
  std::error_code error;
  if (!std::filesystem::is_fifo(options.live_poses, error)) {
    CAIRN_RETURN_IF_ERROR(CheckWritable(options.live_poses, options.overwrite));
  }
  CAIRN_RETURN_IF_ERROR(CheckMap(options));
  std::vector<std::string> inputs = InputFiles(options.input);
  inputs.insert(inputs.end(), {options.poses, options.vocabulary});
  CAIRN_RETURN_IF_ERROR(CheckDistinct(
      {options.map, options.trajectory, options.quality, options.live_poses, options.keyframes, options.picture},
      inputs));
  CAIRN_RETURN_IF_ERROR(CheckPicture(options.picture));
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<io::FrameSource> source, OpenRunInput(options));
  const io::SourceInfo& info = source->info();
  const bool deterministic = options.session.deterministic;
  const nlohmann::ordered_json settings = {
      {"format", std::string(io::SequenceFormatName(info.format))},
      {"from_s", options.input.open.from_s},
      {"until_s",
       std::isfinite(options.input.open.until_s) ? nlohmann::ordered_json(options.input.open.until_s) : nullptr},
      {"stride", options.input.open.stride},
      {"deterministic", deterministic},
      {"preset", options.preset},
      {"full_resolution", options.session.odometry.full_resolution},
      {"close_loops", options.session.close_loops},
      {"refine_lens", options.session.mapping.lens.enabled},
      {"poses_given", !options.poses.empty()}};
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<engine::LiveMap> map,
                         options.extend ? OpenToExtend(options) : CreateMap(options, info, settings.dump()));
  TellNotes("run", map->notes());
  engine::SessionSource session_source = ToSessionSource(info);
  session_source.settings_json = settings.dump();
  session_source.camera_name = options.camera_name;
  return MapRun{std::move(source), std::move(map), std::move(session_source)};
}

std::vector<std::pair<TimeNs, SE3>> MapKeyframePoses(const map::Snapshot& map, ComponentId component) {
  std::vector<std::pair<TimeNs, SE3>> poses;
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (keyframe->component != component) return;
    poses.emplace_back(keyframe->time_ns, keyframe->camera_from_map.Inverse());
  });
  std::sort(poses.begin(), poses.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  return poses;
}

absl::Status WriteMapOutputs(const RunOptions& options, const map::Snapshot& map, ComponentId component,
                             const std::vector<std::pair<TimeNs, SE3>>& frame_poses) {
  return Guarded([&] {
    absl::Status status = WritePoses(options.trajectory, frame_poses, map, component, options.overwrite);
    status.Update(WritePoses(options.keyframes, MapKeyframePoses(map, component), map, component, options.overwrite));
    if (!options.picture.empty()) status.Update(DrawMap(map, options.picture));
    return status;
  });
}

namespace {

std::vector<std::pair<TimeNs, SE3>> PosesToReport(const std::vector<engine::FramePose>& frames, ComponentId component) {
  std::vector<std::pair<TimeNs, SE3>> poses;
  for (const engine::FramePose& frame : frames) {
    if (frame.map_from_camera && frame.component == component)
      poses.emplace_back(frame.time_ns, *frame.map_from_camera);
  }
  return poses;
}

// Without a map there are the odometry's poses: of its longest segment, in a frame and a scale of its own.
absl::Status KeepOdometry(const RunOptions& options, const engine::Session& session, const absl::Status& error) {
  const absl::StatusOr<engine::OdometryReport> odometry = session.FinalOdometry();
  if (!odometry.ok() || (options.trajectory.empty() && options.keyframes.empty())) return error;
  const absl::Status written = WriteOdometryPoses(options, *odometry);
  const std::string files = absl::StrCat(
      options.trajectory, options.trajectory.empty() || options.keyframes.empty() ? "" : ", ", options.keyframes);
  return absl::Status(
      error.code(),
      absl::StrCat(error.message(), "; ",
                   written.ok() ? absl::StrCat("the poses of the odometry, in a scale of its own, are in ", files)
                                : absl::StrCat("nor could its poses be written: ", written.message())));
}

// A run that cannot go on: the poses so far are known, though the map may not be writable any more.
absl::Status KeepWhatIsKnown(const RunOptions& options, const engine::Session& session, const engine::LiveMap& map,
                             const absl::Status& error) {
  return Guarded([&] {
    const ComponentId component = session.Where().component;
    const std::vector<std::pair<TimeNs, SE3>> poses = PosesToReport(session.FramePoses(), component);
    const std::shared_ptr<const map::Snapshot> published = map.Published()->snapshot();
    if (poses.empty() || !published->components().contains(component)) return KeepOdometry(options, session, error);
    return AfterError(error, {options.trajectory, options.keyframes, options.picture},
                      WriteMapOutputs(options, *published, component, poses));
  });
}

}  // namespace

absl::Status MapSequence(const RunOptions& options, InterruptWatch* interrupt) {
  CAIRN_ASSIGN_OR_RETURN(MapRun run, PrepareMapRun(options));
  engine::SessionOptions session_options = options.session;
  if (options.threads > 0) session_options.threads = options.threads;
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<engine::Session> session,
                         engine::Session::Create(session_options, run.session_source, run.map.get()));
  engine::SessionReport report;
  LivePoseFile live(options.live_poses);
  CAIRN_RETURN_IF_ERROR(live.status());
  WhereWatch where(*session, run.session_source.first_ns, options.json || !options.extend);
  const auto add = [&](const engine::FedFrame& fed) -> absl::StatusOr<std::string> {
    const direct::Frame& frame = fed.frame;
    CAIRN_ASSIGN_OR_RETURN(const direct::FrameResult result, session->AddFrame(frame));
    where.Look();
    if (live.count()) {
      if (const std::optional<engine::LivePose> pose = session->PoseInMap(result)) live.Write(result.time_ns, *pose);
    }
    if (result.state == direct::TrackingState::kInitializing) return result.message;
    const std::int64_t keyframes = session->KeyframesInMap();
    // The feature module, which is beside, may have been handed many already.
    return keyframes == 0 ? "tracked, not in the map yet" : absl::StrCat(keyframes, " keyframes");
  };
  bool finishing = false;
  const auto finish = [&]() -> absl::Status {
    finishing = true;
    CAIRN_ASSIGN_OR_RETURN(report, session->Finish());
    return absl::OkStatus();
  };
  const absl::StatusOr<FeedReport> feed = FeedSequence(ToFeedSettings(options, "mapping"), run.source.get(),
                                                       session->preparation(), interrupt, add, finish);
  // An error of the input leaves a session that can be finished.
  const bool finished = feed.ok() || (!finishing && Guarded(finish).ok());
  if (!finished) return KeepWhatIsKnown(options, *session, *run.map, feed.status());
  const absl::Status closed = run.map->Close();
  const std::shared_ptr<const map::Snapshot> map = run.map->Published()->snapshot();
  const ComponentId of_files = ComponentOfFiles(report);
  absl::Status written = WriteMapOutputs(options, *map, of_files, PosesToReport(report.frame_poses, of_files));
  written.Update(WriteQuality(options, report, *map));
  const absl::Status error = feed.ok() ? closed : feed.status();
  if (!error.ok()) return AfterError(error, {options.trajectory, options.keyframes, options.picture}, written);
  CAIRN_RETURN_IF_ERROR(written);
  PrintMapRunReport(options, report, *map, run.source->info(), *feed, *interrupt, live.count());
  return live.status();
}

}  // namespace cairn::cli

// cairn run --map: maps a sequence into a map file.
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <optional>

#include "absl/strings/str_format.h"
#include "base/files.h"
#include "base/guarded.h"
#include "base/version.h"
#include "cli/component_report.h"
#include "cli/pictures.h"
#include "cli/run_options.h"
#include "cli/sample_statistics.h"
#include "cli/session_report.h"
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

// Processor time of the stages of the feature module, per keyframe.
nlohmann::ordered_json StageStatistics(const std::vector<mapping::KeyframeReport>& reports) {
  using mapping::StageTimes;
  constexpr std::pair<const char*, double StageTimes::*> kStages[] = {{"all", &StageTimes::cpu_ms},
                                                                      {"extract", &StageTimes::extract_ms},
                                                                      {"track", &StageTimes::track_ms},
                                                                      {"relocate", &StageTimes::relocate_ms},
                                                                      {"new_points", &StageTimes::new_points_ms},
                                                                      {"fuse", &StageTimes::fuse_ms},
                                                                      {"adjust", &StageTimes::adjust_ms},
                                                                      {"cull", &StageTimes::cull_ms},
                                                                      {"commit", &StageTimes::commit_ms}};
  nlohmann::ordered_json stages;
  for (const auto& [name, time] : kStages) {
    SampleReservoir samples;
    for (const mapping::KeyframeReport& report : reports) samples.Add(static_cast<float>(report.times.*time));
    stages[name] = SampleStatistics(samples);
  }
  return stages;
}

// What the feature module made of each keyframe of the odometry.
nlohmann::ordered_json KeyframeStates(const std::vector<mapping::KeyframeReport>& reports) {
  nlohmann::ordered_json states = nlohmann::ordered_json::array();
  for (const mapping::KeyframeReport& report : reports) {
    states.push_back({{"t", ToSeconds(report.time_ns)},
                      {"state", mapping::FeatureStateName(report.state)},
                      {"inliers", report.inliers},
                      {"inserted", report.inserted},
                      {"relocated", report.relocated},
                      {"restarted", report.restarted}});
  }
  return states;
}

// "41 good, 3 poor, 11 lost", in this order, and what ended the losses.
std::string StateSummary(const std::vector<mapping::KeyframeReport>& reports) {
  using mapping::FeatureState;
  constexpr FeatureState kStates[] = {FeatureState::kInitializing, FeatureState::kGood, FeatureState::kPoor,
                                      FeatureState::kLost};
  std::string summary;
  for (const FeatureState state : kStates) {
    const auto count = std::count_if(reports.begin(), reports.end(), [&](const auto& r) { return r.state == state; });
    if (count == 0) continue;
    absl::StrAppend(&summary, summary.empty() ? "" : ", ", count, " ", mapping::FeatureStateName(state));
  }
  const auto restarts = std::count_if(reports.begin(), reports.end(), [](const auto& r) { return r.restarted; });
  const auto relocated = std::count_if(reports.begin(), reports.end(), [](const auto& r) { return r.relocated; });
  if (relocated > 0) absl::StrAppend(&summary, "; found again in the map ", relocated, " times");
  if (restarts > 0) absl::StrAppend(&summary, "; started again from the odometry's depths ", restarts, " times");
  return summary;
}

// That the files are about: the component with most frames of this session.
ComponentId ComponentOfFiles(const engine::SessionReport& report) {
  const auto most = std::ranges::max_element(report.components, {}, &engine::ComponentShare::frames);
  return most == report.components.end() ? report.component : most->id;
}

// The components of the map, with what this session has in each.
nlohmann::ordered_json SharesAsJson(const map::Snapshot& map, const engine::SessionReport& report, TimeNs first_ns) {
  nlohmann::ordered_json json = ComponentsAsJson(map);
  for (nlohmann::ordered_json& component : json) {
    const auto share = std::ranges::find(report.components, ComponentId(component["id"].get<ComponentId::Value>()),
                                         &engine::ComponentShare::id);
    component["frames"] = share == report.components.end() ? 0 : share->frames;
    if (share == report.components.end() || share->frames == 0) continue;
    component["from_s"] = ToSeconds(share->first_ns - first_ns);
    component["to_s"] = ToSeconds(share->last_ns - first_ns);
  }
  return json;
}

nlohmann::ordered_json JoinsAsJson(const engine::SessionReport& report, TimeNs first_ns) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < report.joins.size(); ++i) {
    const mapping::JoinReport& join = report.joins[i];
    json.push_back({{"at_s", ToSeconds(report.join_times_ns[i] - first_ns)},
                    {"component", join.component.value()},
                    {"into", join.into.value()},
                    {"matches", join.evidence.guided_matches},
                    {"scale", join.scale},
                    {"keyframes_agreeing", join.evidence.neighbours_agreeing + join.sightings_agreeing},
                    {"keyframes_checked", join.evidence.neighbours_checked + join.sightings_checked}});
  }
  return json;
}

// "found in component 1 after 0.4 s (joined at 2.1 s)", "component 2, joined component 1 at 12.3 s", or what it means
// that neither happened.
std::string WhereItIs(const engine::SessionReport& report, const map::Session& session) {
  const auto seconds = [&](TimeNs time_ns) { return absl::StrFormat("%.1f s", ToSeconds(time_ns - session.first_ns)); };
  if (report.located) {
    // Found before there was a component of its own to speak of, or with it.
    const mapping::JoinReport& first = report.joins.front();
    const std::string joined = seconds(report.join_times_ns.front());
    std::string text = report.located->time_ns < report.join_times_ns.front()
                           ? absl::StrCat("found in component ", report.located->component.value(), " after ",
                                          seconds(report.located->time_ns), ", proven and joined at ", joined)
                           : absl::StrCat("component ", first.component.value(), ", joined component ",
                                          first.into.value(), " at ", joined);
    for (std::size_t i = 1; i < report.joins.size(); ++i) {
      absl::StrAppend(&text, "; component ", report.joins[i].component.value(), " joined component ",
                      report.joins[i].into.value(), " at ", seconds(report.join_times_ns[i]));
    }
    return text;
  }
  if (session.policy == map::SessionPolicy::kCreate) return "";
  std::string text =
      absl::StrCat("component ", report.component.value(),
                   ", a place of its own: nothing that this session saw was found in the rest of the map");
  int attempts = 0;
  for (const auto& [why, count] : report.joins_rejected) attempts += count;
  if (attempts > 0) {
    const auto most =
        std::ranges::max_element(report.joins_rejected, {}, [](const auto& entry) { return entry.second; });
    absl::StrAppend(&text, " beyond doubt (", attempts, " keyframes looked alike; mostly: ", most->first, ")");
  }
  return text;
}

void PrintShares(const engine::SessionReport& report, const map::Session& session) {
  const auto with_frames = std::ranges::count_if(report.components, [](const auto& share) { return share.frames > 0; });
  if (with_frames < 2) return;
  std::printf(
      "  this session is in %lld components: tracking was lost, and began anew where nothing known was seen.\n"
      "  Each is right in itself, but how they lie to each other is not known; files hold component %u alone\n",
      static_cast<long long>(with_frames), ComponentOfFiles(report).value());
  for (const engine::ComponentShare& share : report.components) {
    if (share.frames == 0) continue;
    std::printf("    component %u: %lld keyframes, %lld frames from %.1f to %.1f s\n", share.id.value(),
                static_cast<long long>(share.keyframes), static_cast<long long>(share.frames),
                ToSeconds(share.first_ns - session.first_ns), ToSeconds(share.last_ns - session.first_ns));
  }
}

void PrintReport(const RunOptions& options, const engine::SessionReport& report, const map::Snapshot& map,
                 const io::SourceInfo& info, const FeedReport& feed, const InterruptWatch& interrupt,
                 std::optional<std::int64_t> live_poses) {
  const map::Session& session = map.sessions().at(report.session);
  if (options.json) {
    nlohmann::ordered_json json = {{"map", options.map}};
    AddFrameAndUnit(map.WorldFrom(ComponentOfFiles(report)).has_value(), &json);
    AddFeedJson(feed, info, report.frames_tracked, interrupt, &json);
    json.update(
        {{"direct_keyframes", report.direct_keyframes},
         {"keyframes", report.keyframes},
         {"points", report.points},
         {"segments", report.odometry.segments},
         {"recoveries", report.odometry.recoveries},
         {"session", report.session.value()},
         {"result", map::SessionResultName(report.result)},
         {"component", report.component.value()},
         {"component_of_files", ComponentOfFiles(report).value()},
         {"located_after_s",
          report.located ? nlohmann::ordered_json(ToSeconds(report.located->time_ns - session.first_ns)) : nullptr},
         {"joined", JoinsAsJson(report, session.first_ns)},
         {"joins_rejected", report.joins_rejected},
         {"components", SharesAsJson(map, report, session.first_ns)},
         {"feature_losses", report.feature_losses},
         {"loops", LoopsAsJson(session)},
         {"loops_rejected", report.loops_rejected},
         {"trajectory", TrajectoryAsJson(session)},
         {"lens", LensAsJson(report.lens)},
         {"frame_ms", SampleStatistics(report.frame_ms)},
         {"frame_ms_correcting", SampleStatistics(report.frame_ms_correcting)},
         {"loop_correction_ms", SampleStatistics(report.correction_ms)},
         {"loop_adjustment_ms", SampleStatistics(report.adjustment_ms)},
         {"track_ms", SampleStatistics(report.odometry.track.samples_ms)},
         {"keyframe_ms", SampleStatistics(report.keyframe_ms)},
         {"keyframe_cpu_ms", StageStatistics(report.keyframe_reports)},
         {"keyframe_states", KeyframeStates(report.keyframe_reports)},
         {"loop_search_ms", SampleStatistics(report.loop_search_ms)}});
    if (live_poses) json["live_poses"] = *live_poses;
    PrintJson(json);
    return;
  }
  std::printf("%s: %lld keyframes, %lld points\n", options.map.c_str(), static_cast<long long>(report.keyframes),
              static_cast<long long>(report.points));
  if (const std::string where = WhereItIs(report, session); !where.empty()) std::printf("  %s\n", where.c_str());
  PrintFeed(feed, info, report.frames_tracked, interrupt);
  std::printf("  per frame %.2f ms median, %.2f ms mean; per keyframe %.0f ms median in the feature module\n",
              report.frame_ms.Percentile(0.5), report.frame_ms.mean(), report.keyframe_ms.Percentile(0.5));
  PrintLoopsAndTrajectory(session, "  ");
  PrintShares(report, session);
  if (report.lens) std::printf("  lens %s\n", report.lens->reason.c_str());
  std::printf("  keyframes of the odometry in the feature module: %s\n", StateSummary(report.keyframe_reports).c_str());
  if (report.odometry.recoveries > 0) {
    std::printf("  the odometry began at a view that the map knows: %lld of %lld starts\n",
                static_cast<long long>(report.odometry.recoveries), static_cast<long long>(report.odometry.segments));
  }
  if (report.feature_losses > 0) {
    std::printf("  the feature map was lost %lld times%s\n", static_cast<long long>(report.feature_losses),
                report.odometry.segments < 2 ? "; the odometry bridged it" : "");
  }
  if (live_poses) {
    std::printf("  %lld of %lld frames had a pose in the map when they were tracked\n",
                static_cast<long long>(*live_poses), static_cast<long long>(report.frames));
    if (!feed.realtime && !options.session.deterministic) {
      std::printf("  read as fast as possible, frames are ahead of the map: --realtime answers as for a live camera\n");
    }
  }
}

}  // namespace

namespace {

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
  for (const std::string* output : {&options.trajectory, &options.keyframes, &options.picture}) {
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
  CAIRN_RETURN_IF_ERROR(
      CheckDistinct({options.map, options.trajectory, options.live_poses, options.keyframes, options.picture}, inputs));
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
  for (const std::string& note : map->notes()) std::cerr << "cairn run: " << note << "\n";
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

// A run that cannot go on: the poses so far are known, though the map may not be writable any more.
absl::Status KeepWhatIsKnown(const RunOptions& options, const engine::Session& session, const engine::LiveMap& map,
                             const absl::Status& error) {
  return Guarded([&] {
    const ComponentId component = session.Where().component;
    const std::vector<std::pair<TimeNs, SE3>> poses = PosesToReport(session.FramePoses(), component);
    const std::shared_ptr<const map::Snapshot> published = map.Published()->snapshot();
    if (poses.empty() || !published->components().contains(component)) return error;
    return AfterError(error, {options.trajectory, options.keyframes, options.picture},
                      WriteMapOutputs(options, *published, component, poses));
  });
}

// Says where the session is as soon as that is known, and what it is sure of.
class WhereWatch {
 public:
  WhereWatch(const engine::Session& session, TimeNs first_ns, bool quiet)
      : session_(session), first_ns_(first_ns), quiet_(quiet) {}

  void Look() {
    if (quiet_) return;
    const engine::Whereabouts where = session_.Where();
    if (where.located && !seen_) {
      seen_ = true;
      Say(absl::StrFormat("looks like component %u after %.1f s; joined as soon as that is proven",
                          where.located->component.value(), ToSeconds(where.located->time_ns - first_ns_)));
    }
    if (where.joined_ns && !joined_) {
      joined_ = true;
      Say(absl::StrFormat("joined to component %u at %.1f s", where.component.value(),
                          ToSeconds(*where.joined_ns - first_ns_)));
    }
  }

 private:
  // On a terminal over the bar, which is drawn again.
  static void Say(const std::string& text) { std::cerr << (isatty(2) != 0 ? "\r\033[K" : "") << text << "\n"; }

  const engine::Session& session_;
  const TimeNs first_ns_;
  const bool quiet_;
  bool seen_ = false, joined_ = false;
};

// The pose of each frame as soon as it is tracked. What cannot be written ends these poses, not the run.
class LiveFile {
 public:
  explicit LiveFile(const std::string& path) : path_(path) {
    if (path_.empty()) return;
    errno = 0;
    file_.open(path_);
    if (!file_) Fail();
  }

  void Write(TimeNs time_ns, const engine::LivePose& pose) {
    if (path_.empty() || !status_.ok()) return;
    const bool in_world = pose.world_from_component.has_value();
    if (pose.component != component_ || in_world != in_world_) {
      file_ << "# component " << pose.component.value() << ", "
            << (in_world ? "world_from_camera, metres" : "map_from_camera, in the frame and unit of the component")
            << ", from here on\n";
      component_ = pose.component;
      in_world_ = in_world;
    }
    file_ << io::FormatTumLine({time_ns, pose.WorldFromCamera()}) << std::flush;
    if (!file_) return Fail();
    ++count_;
  }
  std::optional<std::int64_t> count() const { return path_.empty() ? std::nullopt : std::optional(count_); }
  const absl::Status& status() const { return status_; }

 private:
  void Fail() {
    status_ = absl::UnavailableError(
        absl::StrCat("the live poses could not all be written to ", path_, ": ", std::strerror(errno)));
  }

  const std::string path_;
  std::ofstream file_;
  std::int64_t count_ = 0;
  ComponentId component_;
  bool in_world_ = false;
  absl::Status status_;
};

}  // namespace

absl::Status MapSequence(const RunOptions& options, InterruptWatch* interrupt) {
  CAIRN_ASSIGN_OR_RETURN(MapRun run, PrepareMapRun(options));
  engine::SessionOptions session_options = options.session;
  if (options.threads > 0) session_options.threads = options.threads;
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<engine::Session> session,
                         engine::Session::Create(session_options, run.session_source, run.map.get()));
  engine::SessionReport report;
  LiveFile live(options.live_poses);
  CAIRN_RETURN_IF_ERROR(live.status());
  WhereWatch where(*session, run.session_source.first_ns, options.json || !options.extend);
  const auto add = [&](const direct::Frame& frame) -> absl::StatusOr<std::string> {
    CAIRN_ASSIGN_OR_RETURN(const direct::FrameResult result, session->AddFrame(frame));
    where.Look();
    if (live.count()) {
      if (const std::optional<engine::LivePose> pose = session->PoseInMap(result)) live.Write(result.time_ns, *pose);
    }
    const bool waits = result.state == direct::TrackingState::kInitializing;
    return waits ? result.message : absl::StrCat(session->KeyframesInMap(), " keyframes");
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
  const absl::Status written = WriteMapOutputs(options, *map, of_files, PosesToReport(report.frame_poses, of_files));
  const absl::Status error = feed.ok() ? closed : feed.status();
  if (!error.ok()) return AfterError(error, {options.trajectory, options.keyframes, options.picture}, written);
  CAIRN_RETURN_IF_ERROR(written);
  PrintReport(options, report, *map, run.source->info(), *feed, *interrupt, live.count());
  return live.status();
}

}  // namespace cairn::cli

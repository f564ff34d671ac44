// cairn track: follows a camera through a sequence in a map that is only read.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <map>
#include <thread>

#include "absl/strings/str_format.h"
#include "api/tracker.h"
#include "base/files.h"
#include "base/guarded.h"
#include "cli/cli.h"
#include "cli/component_report.h"
#include "cli/input_options.h"
#include "cli/interrupt.h"
#include "cli/map_to_read.h"
#include "cli/process_memory.h"
#include "cli/sample_statistics.h"
#include "cli/server_option.h"
#include "cli/track_target.h"
#include "io/trajectory.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

using Clock = std::chrono::steady_clock;

struct TrackOptions {
  InputOptions input;
  ServerChoice server;
  std::string map;
  std::string out;
  std::string states;
  std::string mode = "semi_direct";
  double realtime_speed = 0.0;
  bool deterministic = false;
  bool server_side = false;
  bool overwrite = false;
  bool json = false;
};

constexpr std::array kStates = {api::TrackState::kLocated, api::TrackState::kTracked, api::TrackState::kCarried,
                                api::TrackState::kLost};

// Per axis, of the camera's centre in the unit of the pose that is written, and of its orientation in degrees. The
// covariance is of a left increment, which turns about the origin.
struct Sigma {
  double position = 0.0;
  double rotation_deg = 0.0;
};

Sigma SigmaOf(const api::TrackAnswer& answer) {
  Eigen::Matrix<double, 3, 6> by_increment;
  by_increment << Matrix3d::Identity(), -Hat(answer.map_from_camera.translation());
  const double position2 = (by_increment * answer.covariance * by_increment.transpose()).trace();
  const double rotation2 = answer.covariance.bottomRightCorner<3, 3>().trace();
  const double unit = answer.world_is_metric ? answer.world_per_map : 1.0;
  return {unit * std::sqrt(position2 / 3.0), std::sqrt(rotation2 / 3.0) * 180.0 / M_PI};
}

// A reason without its numbers, so that equal ones are counted together.
std::string Kind(const std::string& reason) {
  std::string kind;
  for (const char c : reason) {
    if (c >= '0' && c <= '9') {
      if (kind.empty() || kind.back() != '#') kind += '#';
    } else if (c != '.' || kind.empty() || kind.back() != '#') {
      kind += c;
    }
  }
  return kind;
}

// What came of all frames.
struct TrackSummary {
  std::int64_t frames = 0;
  std::int64_t dropped = 0;    // that came too fast, in real time
  std::int64_t refused = 0;    // whose time does not follow that of the one before
  std::int64_t elsewhere = 0;  // with a pose in a component whose frame is not that of the file
  std::array<std::int64_t, kStates.size()> of_state = {};
  std::map<std::string, std::int64_t> reasons;  // of losses
  SampleReservoir track_ms;
  double cpu_s = 0.0;  // of the process while it tracked, reading the images included
  double wall_s = 0.0;
  TimeNs first_ns = 0, last_ns = 0;
  struct Pose {
    TimeNs time_ns = 0;
    ComponentId component;
    SE3 map_from_camera;
  };
  std::vector<Pose> answered;             // those with a pose
  std::vector<io::StampedPose> poses;     // in the frame that they share at the end
  std::string states;                     // a line per frame
  std::optional<TimeNs> in_metres_since;  // as which the states' sigmas are then
  bool in_map_units = false;              // as which some of them are
  std::string map_id;
  std::string note;
  bool map_damaged = false;
  double focal_factor = 1.0;      // that the frames show at last, if they contradict the calibration
  std::int64_t disconnected = 0;  // frames that were answered without the server
  double map_age_s = 0.0;         // the most that what was known of the map had lagged behind
  Revision revision = 0;
  std::vector<ComponentId> together;  // components of the poses, which share a frame ...
  bool metric = false;                // ... that is the world

  std::int64_t WithPose() const { return frames - of_state[3]; }

  void Add(const api::TrackAnswer& answer, bool keep_state) {
    if (frames++ == 0) first_ns = answer.time_ns;
    last_ns = answer.time_ns;
    ++of_state[static_cast<std::size_t>(answer.state)];
    track_ms.Add(static_cast<float>(answer.track_ms));
    map_id = answer.map_id;
    revision = answer.revision;
    if (answer.map_damaged || !map_damaged) note = answer.note;
    map_damaged |= answer.map_damaged;
    if (answer.focal_factor != 1.0 || answer.state != api::TrackState::kLost) focal_factor = answer.focal_factor;
    if (!answer.connected) ++disconnected;
    map_age_s = std::max(map_age_s, answer.map_age_s);
    if (answer.state == api::TrackState::kLost) {
      ++reasons[Kind(answer.reason)];
    } else {
      answered.push_back({answer.time_ns, answer.component, answer.map_from_camera});
      if (!answer.world_is_metric) in_map_units = true;
      if (answer.world_is_metric && !in_metres_since) in_metres_since = answer.time_ns;
    }
    if (keep_state) states += StateLine(answer);
  }

  // Whether the map has not been aligned, or begun, or joined meanwhile.
  bool StillIn(const CommonFrame& frame) const {
    return in_metres_since.has_value() == (frame.metric && !answered.empty()) &&
           std::ranges::all_of(answered, [&](const Pose& pose) {
             return std::ranges::find(frame.components, pose.component) != frame.components.end();
           });
  }

  // The map as it is at the end.
  void PutInto(const CommonFrame& frame) {
    together = frame.components;
    metric = frame.metric;
    for (const Pose& pose : answered) {
      const auto found = std::ranges::find(together, pose.component);
      if (found == together.end()) {
        ++elsewhere;
        continue;
      }
      const Sim3& common = frame.common_from[static_cast<std::size_t>(found - together.begin())];
      poses.push_back({pose.time_ns, metric ? common.TransformPose(pose.map_from_camera) : pose.map_from_camera});
    }
  }

  std::string UnitOfStates() const {
    if (!in_metres_since) return "map units";
    return in_map_units ? absl::StrCat("map units, from t = ", io::FormatSeconds(*in_metres_since), " on in m") : "m";
  }

  static std::string StateLine(const api::TrackAnswer& answer) {
    std::string line = absl::StrFormat("%s %s", io::FormatSeconds(answer.time_ns), api::TrackStateName(answer.state));
    if (answer.state == api::TrackState::kLost) {
      absl::StrAppend(&line, " - - - -");
    } else {
      const Sigma sigma = SigmaOf(answer);
      absl::StrAppendFormat(&line, " %.6f %.4f %u %d", sigma.position, sigma.rotation_deg, answer.component.value(),
                            answer.inliers);
    }
    absl::StrAppendFormat(&line, " %d %.3f %s\n", answer.revision, answer.track_ms,
                          answer.reason.empty() ? "-" : answer.reason);
    return line;
  }
};

client::LocalTrackerOptions TrackerOptions(const TrackOptions& options, const io::SourceInfo& info) {
  client::LocalTrackerOptions tracker;
  tracker.photometric = info.photometric;
  tracker.mode = options.mode == "features" ? client::TrackMode::kFeatures : client::TrackMode::kSemiDirect;
  tracker.deterministic = options.deterministic;
  tracker.wait_for_matches = options.realtime_speed == 0.0;
  return tracker;
}

double ProcessCpuSeconds() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

// The images of the sequence in order; in real time at the pace of the recording: one that is still waiting when the
// next one is due is dropped, as a camera does that waits for nobody.
class PacedSource {
 public:
  PacedSource(io::FrameSource* source, double speed, SkippedFrames* skipped)
      : source_(*source), speed_(speed), skipped_(*skipped) {}

  absl::StatusOr<std::optional<io::SourceFrame>> Next(std::int64_t* dropped) {
    CAIRN_ASSIGN_OR_RETURN(std::optional<io::SourceFrame> frame, TakeAhead());
    if (!frame || speed_ <= 0.0) return frame;
    if (!begin_) begin_ = Clock::now(), first_ns_ = frame->time_ns;
    for (;;) {
      CAIRN_ASSIGN_OR_RETURN(ahead_, ReadUsable());
      if (!ahead_ || Clock::now() < Due(ahead_->time_ns)) break;
      frame = std::exchange(ahead_, std::nullopt);
      ++*dropped;
    }
    std::this_thread::sleep_until(Due(frame->time_ns));
    return frame;
  }

 private:
  absl::StatusOr<std::optional<io::SourceFrame>> TakeAhead() {
    if (ahead_) return std::exchange(ahead_, std::nullopt);
    return ReadUsable();
  }
  absl::StatusOr<std::optional<io::SourceFrame>> ReadUsable() {
    for (;;) {
      CAIRN_ASSIGN_OR_RETURN(std::optional<io::SourceFrame> frame, source_.Next());
      if (!frame || frame->status.ok()) return frame;
      skipped_.Add(frame->path, frame->status);
    }
  }
  Clock::time_point Due(TimeNs time_ns) const {
    return *begin_ + std::chrono::duration_cast<Clock::duration>(
                         std::chrono::duration<double>(ToSeconds(time_ns - first_ns_) / speed_));
  }

  io::FrameSource& source_;
  const double speed_;  // 0: as fast as they are taken
  SkippedFrames& skipped_;
  std::optional<io::SourceFrame> ahead_;
  std::optional<Clock::time_point> begin_;
  TimeNs first_ns_ = 0;
};

absl::Status TrackAll(const TrackOptions& options, io::FrameSource& source, TrackTarget& target,
                      const std::atomic<bool>& stop, SkippedFrames* skipped, TrackSummary* summary) {
  Progress progress("tracking", source.info().num_frames, options.json);
  PacedSource paced(&source, options.realtime_speed, skipped);
  const double cpu_s = ProcessCpuSeconds();
  const Clock::time_point begin = Clock::now();
  while (!stop) {
    CAIRN_ASSIGN_OR_RETURN(const std::optional<io::SourceFrame> frame, paced.Next(&summary->dropped));
    if (!frame) break;
    const absl::StatusOr<api::TrackAnswer> answer =
        target.tracker->Track({frame->gray, frame->time_ns, frame->exposure_s});
    if (absl::IsInvalidArgument(answer.status())) {
      if (summary->refused++ == 0) skipped->Add(frame->path, answer.status());
      continue;
    }
    CAIRN_RETURN_IF_ERROR(answer.status());
    summary->Add(*answer, !options.states.empty());
    progress.Update(frame->index + 1, absl::StrCat(summary->WithPose(), " of ", summary->frames, " with a pose"));
  }
  summary->cpu_s = ProcessCpuSeconds() - cpu_s;
  summary->wall_s = std::chrono::duration<double>(Clock::now() - begin).count();
  return absl::OkStatus();
}

absl::Status WriteOutputs(const TrackOptions& options, const TrackSummary& summary) {
  const std::string map = absl::StrCat("map ", summary.map_id, " revision ", summary.revision);
  absl::Status status;
  if (!options.out.empty()) {
    io::TrajectoryWriteOptions write;
    write.overwrite = options.overwrite;
    write.comment = absl::StrCat("t tx ty tz qx qy qz qw: ", summary.metric ? "world" : "map", "_from_camera, ", map);
    status.Update(io::WriteTumTrajectory(options.out, summary.poses, write));
  }
  if (!options.states.empty()) {
    status.Update(WriteFileAtomically(
        options.states,
        absl::StrCat(
            "# t state position_sigma rotation_sigma_deg component inliers revision track_ms reason: sigmas per "
            "axis, positions in ",
            summary.UnitOfStates(), ", ", map, "\n", summary.states),
        options.overwrite));
  }
  return status;
}

void PrintSummary(const TrackOptions& options, const TrackSummary& summary, std::int64_t skipped, bool interrupted) {
  const auto share = [&](std::int64_t count) {
    return summary.frames > 0 ? static_cast<double>(count) / static_cast<double>(summary.frames) : 0.0;
  };
  const double video_s = ToSeconds(summary.last_ns - summary.first_ns);
  const double cpu_per_s = video_s > 0.0 ? summary.cpu_s / video_s : 0.0;
  if (options.json) {
    nlohmann::ordered_json json = {{"map", summary.map_id}, {"revision", summary.revision}};
    AddFrameAndUnit(summary.metric, &json);
    json.update({{"mode", options.mode}, {"frames", summary.frames}, {"with_pose_share", share(summary.WithPose())}});
    for (const api::TrackState state : kStates) {
      const std::int64_t count = summary.of_state[static_cast<std::size_t>(state)];
      json[api::TrackStateName(state)] = count;
      json[absl::StrCat(api::TrackStateName(state), "_share")] = share(count);
    }
    json.update({{"in_other_components", summary.elsewhere},
                 {"losses", summary.reasons},
                 {"frames_skipped", skipped},
                 {"frames_dropped", summary.dropped},
                 {"frames_out_of_order", summary.refused},
                 {"interrupted", interrupted},
                 {"calibration_contradicted", summary.focal_factor != 1.0},
                 {"focal_factor", summary.focal_factor},
                 {"track_ms", SampleStatistics(summary.track_ms)},
                 {"cpu_s_per_s", cpu_per_s},
                 {"elapsed_s", summary.wall_s},
                 {"peak_memory_mb", PeakMemoryMb()}});
    if (!options.server.empty()) {
      json["tracked_at"] = options.server_side ? "server" : "client";
      json["frames_without_server"] = summary.disconnected;
      json["map_age_s"] = summary.map_age_s;
    }
    if (!summary.note.empty()) json["note"] = summary.note;
    json["map_damaged"] = summary.map_damaged;
    if (summary.map_damaged) json["error"] = summary.note;
    PrintJson(json);
    return;
  }
  // Those that came too fast are frames of the camera, too, and have none.
  const std::int64_t due = summary.frames + summary.dropped;
  text::Say(absl::StrFormat("a pose for %lld of %lld frames (%.1f %%), %.2f ms median each (p99 %.2f)\n",
                            static_cast<long long>(summary.WithPose()), static_cast<long long>(due),
                            due > 0 ? 100.0 * static_cast<double>(summary.WithPose()) / static_cast<double>(due) : 0.0,
                            summary.track_ms.Percentile(0.5), summary.track_ms.Percentile(0.99)));
  for (const api::TrackState state : kStates) {
    const std::int64_t count = summary.of_state[static_cast<std::size_t>(state)];
    std::printf("  %-8s %6lld  %5.1f %%\n", api::TrackStateName(state), static_cast<long long>(count),
                100.0 * share(count));
  }
  for (const auto& [reason, count] : summary.reasons) {
    text::Say(absl::StrFormat("  lost %lld times: %s\n", static_cast<long long>(count), text::Shown(reason)));
  }
  text::Say(
      absl::StrFormat("  %.2f s of processor time per second of video, reading the images included\n", cpu_per_s));
  if (summary.elsewhere > 0) {
    text::Say(absl::StrFormat("  %lld in other components than those of the files, %s (cairn info)\n",
                              static_cast<long long>(summary.elsewhere), NameComponents(summary.together)));
  }
  if (summary.dropped > 0)
    text::Say(absl::StrFormat("  %lld frames came too fast: they were not tracked\n",
                              static_cast<long long>(summary.dropped)));
  if (skipped > 0) text::Say(absl::StrFormat("  %lld images could not be used\n", static_cast<long long>(skipped)));
  if (summary.disconnected > 0) {
    text::Say(absl::StrFormat("  %lld frames without the server, in what was known of the map, up to %.1f s old\n",
                              static_cast<long long>(summary.disconnected), summary.map_age_s));
  }
  if (summary.focal_factor != 1.0) {
    text::Say(absl::StrFormat(
        "  WARNING: the calibration does not fit the images, which show another one, with a focal length of about x "
        "%.3f: the poses are off, and less sure than usual; calibrate the camera\n",
        summary.focal_factor));
  }
  if (summary.map_damaged) {
    text::Say(absl::StrFormat("  WARNING: the map is damaged, and poses come from what could be read of it: %s\n",
                              text::Shown(summary.note)));
  } else if (!summary.note.empty()) {
    text::Say(absl::StrFormat("  the map was not followed: %s\n", text::Shown(summary.note)));
  }
  if (interrupted) text::Say("  interrupted: this is what was done until then\n");
  if (!summary.metric) text::Say("  the map is not aligned: poses are in its own units and frame (cairn align)\n");
}

absl::StatusOr<int> Track(const TrackOptions& options) {
  InterruptWatch interrupt;
  std::vector<std::string> inputs = InputFiles(options.input);
  if (options.server.empty()) inputs.push_back(options.map);
  CAIRN_RETURN_IF_ERROR(CheckDistinct({options.out, options.states}, inputs));
  for (const std::string* output : {&options.out, &options.states}) {
    CAIRN_RETURN_IF_ERROR(CheckWritable(*output, options.overwrite));
  }
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<io::FrameSource> source, OpenInput(options.input, "track"));
  ServerChoice server = options.server;
  server.interrupt = &interrupt;
  TellLogDamage("track", server, options.map);
  CAIRN_ASSIGN_OR_RETURN(TrackTarget target,
                         OpenTrackTarget(server, options.map, source->info().camera,
                                         TrackerOptions(options, source->info()), options.server_side));
  CAIRN_ASSIGN_OR_RETURN(CommonFrame common, target.frame());
  SkippedFrames skipped("track", options.json);
  TrackSummary summary;
  absl::Status status;
  {
    std::atomic<bool> stop = false;
    const InterruptWatch::Guard guard(&interrupt, [&] { stop = true; });
    status = Guarded([&] { return TrackAll(options, *source, target, stop, &skipped, &summary); });
  }
  const bool interrupted = interrupt.exit_code() != 0;
  if (interrupted && absl::IsUnavailable(status)) status = absl::OkStatus();  // it waited for a server
  if (!summary.StillIn(common)) {
    if (absl::StatusOr<CommonFrame> now = target.frame(); now.ok()) common = *std::move(now);
  }
  summary.PutInto(common);
  if (status.ok() && summary.frames == 0 && !interrupted) {
    return absl::DataLossError(
        absl::StrCat("none of the ", skipped.count(), " images of ", options.input.sequence, " could be used"));
  }
  const absl::Status written = WriteOutputs(options, summary);
  if (!status.ok()) return AfterError(status, {options.out, options.states}, written);
  CAIRN_RETURN_IF_ERROR(written);
  PrintSummary(options, summary, skipped.count(), interrupted);
  if (interrupted) return interrupt.exit_code();
  if (summary.map_damaged) return kDamagedMap;
  return summary.WithPose() > 0 ? kOk : kNotLocalized;
}

}  // namespace

void AddTrackCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("track", "Follow a camera through a sequence in a map that is not touched");
  auto options = std::make_shared<TrackOptions>();
  AddInputOptions(verb, &options->input);
  verb->add_option("--map", options->map, "Map file (.cairn), with --server the name of a map there; it is only read")
      ->required();
  verb->add_option("--out", options->out,
                   "Write the poses of located, tracked and carried frames to this file (TUM format; in the world if "
                   "the map is aligned); of a map of several components those in the aligned ones, or in the largest");
  verb->add_option("--states", options->states,
                   "Write state and uncertainty of every frame to this file, a line each, with the reason of a loss");
  verb->add_option("--mode", options->mode,
                   "semi_direct: direct tracking for every frame, ORB beside it; features: ORB for every frame")
      ->check(CLI::IsMember({"semi_direct", "features"}))
      ->capture_default_str();
  CLI::Option* realtime =
      verb->add_option(
              "--realtime", options->realtime_speed,
              "Play the recording like a live camera that waits for nobody: at its own pace, or SPEED times as "
              "fast")
          ->type_name("[SPEED]")
          ->check(CLI::Range(0.001, 1000.0));
  verb->add_flag("--deterministic", options->deterministic,
                 "One thread and a fixed order: the same input gives the same output")
      ->excludes(realtime);
  verb->add_flag("--server-side", options->server_side,
                 "With --server: every frame is sent there. Without it the map is: it is kept here and follows what "
                 "changes there, also through an outage");
  verb->add_flag("--overwrite", options->overwrite, "Replace files that exist");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "Beside a session that extends the map its changes are followed.\n"
      "Exit codes: 0 ok, 1 failure, 2 usage, 3 map damaged (poses come from what could be read of it), 4 no frame has\n"
      "a pose, 5 version.\n"
      "Examples:\n"
      "  cairn track second_visit --camera camera.yaml --map office.cairn --out poses.txt\n"
      "  cairn track second_visit --map office.cairn --out poses.txt --states states.txt --realtime\n"
      "  cairn track second_visit --map office.cairn --mode features --json\n"
      "  cairn --server localhost:7878 track second_visit --map office --realtime\n"
      "  cairn --server localhost:7878 track second_visit --map office --server-side");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    const auto refuse = [&](const char* option, const char* with) {
      if (verb->get_option(option)->count() > 0) throw CLI::ExcludesError(option, with);
    };
    if (!options->server.empty()) refuse("--deterministic", "--server");
    if (options->server_side) refuse("--mode", "--server-side");
    if (options->server.empty() && options->server_side) throw CLI::RequiresError("--server-side", "--server");
    *action = [=] {
      const absl::StatusOr<int> code = Track(*options);
      return code.ok() ? *code : Fail("track", code.status(), options->json);
    };
  });
}

}  // namespace cairn::cli

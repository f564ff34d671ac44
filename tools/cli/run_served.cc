// cairn --server HOST:PORT run: maps a sequence into a map of a server, frame by frame.
#include <algorithm>
#include <cstdio>
#include <iostream>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/guarded.h"
#include "cli/live_pose_file.h"
#include "cli/outputs.h"
#include "cli/run_options.h"
#include "cli/server_option.h"
#include "io/trajectory.h"
#include "store/fault.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

// A server that takes longer than this for a frame is away rather than slow: the camera's frames wait for it.
constexpr double kStallS = 0.5;

api::SessionRequest RequestOf(const RunOptions& options, const io::SourceInfo& info) {
  api::SessionRequest request;
  request.map = options.map;
  request.policy = options.extend ? map::SessionPolicy::kExtend : map::SessionPolicy::kCreate;
  request.camera = info.camera;
  request.camera_name = options.camera_name;
  request.source = info.name;
  request.title = options.name;
  request.first_ns = info.first_time_ns;
  return request;
}

// What leads from the frame of each component to that of one: those that were joined to it since, and itself.
using FramesOf = std::map<ComponentId, Sim3>;

FramesOf FramesInto(ComponentId component, const std::vector<map::Component>& components) {
  FramesOf into = {{component, Sim3()}};
  // A component that was joined to one of these, until there are no more.
  for (std::size_t known = 0; known != into.size();) {
    known = into.size();
    for (const map::Component& joined : components) {
      if (!joined.joined || into.contains(joined.id)) continue;
      const auto further = into.find(joined.joined->into);
      if (further != into.end()) into.emplace(joined.id, further->second * joined.joined->into_from_component);
    }
  }
  return into;
}

// What was answered, frame by frame: all that is known of those whose session did not come to its end.
class AnsweredPoses {
 public:
  void Add(const api::SessionAnswer& answer) {
    ++answers_;
    if (answer.map_from_camera) poses_.push_back(answer);
  }
  std::int64_t answers() const { return answers_; }
  ComponentId last_component() const { return poses_.empty() ? ComponentId() : poses_.back().component; }

  // Of frames before `before_ns`, brought into one frame and then, if given, into the world.
  std::vector<io::StampedPose> In(const FramesOf& frames, const std::optional<Sim3>& world_from_component,
                                  TimeNs before_ns) const {
    std::vector<io::StampedPose> poses;
    for (const api::SessionAnswer& answer : poses_) {
      const auto frame = frames.find(answer.component);
      if (frame == frames.end() || answer.time_ns >= before_ns) continue;
      // Frames that were sent again were answered again.
      if (!poses.empty() && answer.time_ns <= poses.back().time_ns) continue;
      const SE3 pose = frame->second.TransformPose(*answer.map_from_camera);
      poses.push_back({answer.time_ns, world_from_component ? world_from_component->TransformPose(pose) : pose});
    }
    return poses;
  }
  std::int64_t Before(TimeNs time_ns) const {
    return std::ranges::count_if(poses_, [&](const api::SessionAnswer& answer) { return answer.time_ns < time_ns; });
  }
  // Of a session that failed: where it was last, in the frame of the last answer.
  std::vector<io::StampedPose> Last() const {
    if (poses_.empty()) return {};
    return In({{last_component(), Sim3()}}, poses_.back().world_from_component, std::numeric_limits<TimeNs>::max());
  }
  bool last_in_world() const { return !poses_.empty() && poses_.back().world_from_component.has_value(); }

 private:
  std::vector<api::SessionAnswer> poses_;
  std::int64_t answers_ = 0;
};

absl::Status WriteTrajectory(const RunOptions& options, const std::vector<io::StampedPose>& poses,
                             ComponentId component, bool in_world, const std::string& note) {
  if (options.trajectory.empty()) return absl::OkStatus();
  io::TrajectoryWriteOptions write;
  write.overwrite = options.overwrite;
  write.comment =
      absl::StrCat("t tx ty tz qx qy qz qw: ", in_world ? "world" : "map", "_from_camera, map ", options.map,
                   " of a server", component.valid() ? absl::StrCat(", component ", component.value()) : "", note);
  return io::WriteTumTrajectory(options.trajectory, poses, write);
}

struct ServedTrajectory {
  std::vector<io::StampedPose> poses;
  std::int64_t as_answered = 0;      // of them, of before the server was started again
  std::int64_t answered_before = 0;  // with a pose then, wherever it was
};

ServedTrajectory TrajectoryOf(const api::SessionSummary& summary, const AnsweredPoses& answered, const std::string& map,
                              api::MapService& service) {
  ServedTrajectory trajectory;
  const auto& world = summary.world_from_component;
  // Of one session the summary has everything.
  if (answered.answers() > summary.frames && !summary.poses.empty()) {
    const TimeNs first_ns = summary.poses.front().time_ns;
    FramesOf frames = {{summary.component, Sim3()}};
    const absl::StatusOr<map::MapOverview> overview = service.Overview(map);
    if (overview.ok()) frames = FramesInto(summary.component, overview->components);
    trajectory.poses = answered.In(frames, world, first_ns);
    trajectory.answered_before = answered.Before(first_ns);
  }
  trajectory.as_answered = static_cast<std::int64_t>(trajectory.poses.size());
  for (const api::SessionSummary::Pose& pose : summary.poses) {
    trajectory.poses.push_back(
        {pose.time_ns, world ? world->TransformPose(pose.map_from_camera) : pose.map_from_camera});
  }
  return trajectory;
}

absl::Status WriteTrajectory(const RunOptions& options, const api::SessionSummary& summary,
                             const ServedTrajectory& trajectory) {
  std::string note = absl::StrCat(" revision ", summary.revision);
  if (trajectory.as_answered > 0) {
    absl::StrAppend(&note, "; the first ", trajectory.as_answered,
                    " poses are those answered live, before the server was started again");
  }
  return WriteTrajectory(options, trajectory.poses, summary.component, summary.world_from_component.has_value(), note);
}

// What is known of the frames before the server was started again.
std::string PosesBeforeRestart(const ServedTrajectory& trajectory, ComponentId component) {
  if (trajectory.answered_before == 0) return "(none of them had been answered with a pose)";
  const std::string answered =
      absl::StrCat("(", trajectory.answered_before, " of them had been answered with a pose: ");
  if (trajectory.as_answered == trajectory.answered_before) return absl::StrCat(answered, "the trajectory has those)");
  return absl::StrCat(answered, "the trajectory has the ", trajectory.as_answered, " in component ", component.value(),
                      " or one that has been joined to it, --live-poses has all)");
}

void PrintServedRun(const RunOptions& options, const api::SessionSummary& summary, const io::SourceInfo& info,
                    const FeedReport& feed, const InterruptWatch& interrupt, std::optional<std::int64_t> live_poses,
                    const AnsweredPoses& answered, const ServedTrajectory& trajectory) {
  // A server that was killed began another session with what was not durable: the last one alone has final poses.
  const std::int64_t before_restart = std::max<std::int64_t>(0, answered.answers() - summary.frames);
  const std::int64_t tracked = summary.frames_tracked + trajectory.answered_before;
  if (options.json) {
    nlohmann::ordered_json json = {{"map", options.map}};
    AddFrameAndUnit(summary.world_from_component.has_value(), &json);
    AddFeedJson(feed, info, tracked, interrupt, &json);
    json.update({{"session", summary.session.value()},
                 {"result", map::SessionResultName(summary.result)},
                 {"component", summary.component.value()},
                 {"keyframes", summary.keyframes},
                 {"points", summary.points},
                 {"joins", summary.joins},
                 {"loops", summary.loops},
                 {"revision", summary.revision},
                 {"frames_with_final_pose", summary.poses.size()},
                 {"frames_before_restart", before_restart},
                 {"poses_as_answered", trajectory.as_answered},
                 {"live_poses", live_poses ? nlohmann::ordered_json(*live_poses) : nullptr}});
    PrintJson(json);
    return;
  }
  std::printf("%s: session %u, %lld keyframes, %lld points, revision %llu; %s\n", text::Shown(options.map).c_str(),
              summary.session.value(), static_cast<long long>(summary.keyframes),
              static_cast<long long>(summary.points), static_cast<unsigned long long>(summary.revision),
              summary.result == map::SessionResult::kLocated ? "found in what was there"
              : summary.result == map::SessionResult::kApart ? "joined to nothing that was there"
                                                             : "made the map");
  PrintFeed(feed, info, tracked, interrupt);
  if (before_restart > 0) {
    std::printf(
        "  the server was started again on the way: %lld frames before that are in the map, but have no final pose\n",
        static_cast<long long>(before_restart));
    std::printf("  %s\n", PosesBeforeRestart(trajectory, summary.component).c_str());
  }
  const auto posed = static_cast<std::int64_t>(summary.poses.size());
  if (posed < summary.frames_tracked) {
    std::printf(
        "  %lld of the frames tracked lie in parts that nothing links to component %u: the trajectory has the "
        "%lld\n  in that one\n",
        static_cast<long long>(summary.frames_tracked - posed), summary.component.value(),
        static_cast<long long>(posed));
  }
}

// As a run of a file says it.
absl::Status WithRemedy(const RunOptions& options, const absl::Status& status) {
  const store::Fault fault = store::FaultOf(status);
  const char* remedy = "";
  if (fault == store::Fault::kExists && !options.extend) {
    remedy = ": give --extend to add this session to it, or choose another name";
  } else if (fault == store::Fault::kNotFound && options.extend) {
    remedy = " to extend: leave --extend out to make it";
  }
  return *remedy == 0 ? status : store::MakeFault(fault, absl::StrCat(status.message(), remedy));
}

// On the terminal, as soon as it is known.
void SayWhere(const api::SessionProgress& now, const api::SessionProgress& before, TimeNs first_ns) {
  if (now.located_ns && !before.located_ns) {
    std::cerr << "looks like component " << now.located_component.value() << " after "
              << ToSeconds(*now.located_ns - first_ns) << " s; joined as soon as that is proven\n";
  }
  if (now.joined_ns && !before.joined_ns) {
    std::cerr << "joined to component " << now.component.value() << " at " << ToSeconds(*now.joined_ns - first_ns)
              << " s\n";
  }
}

}  // namespace

absl::Status MapServed(const RunOptions& options, InterruptWatch* interrupt) {
  CAIRN_RETURN_IF_ERROR(CheckWritable(options.trajectory, options.overwrite));
  CAIRN_RETURN_IF_ERROR(CheckWritable(options.live_poses, options.overwrite));
  CAIRN_RETURN_IF_ERROR(CheckDistinct({options.trajectory, options.live_poses}, InputFiles(options.input)));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<io::FrameSource> source, OpenRunInput(options));
  CAIRN_ASSIGN_OR_RETURN(const engine::FramePreparation preparation,
                         engine::FramePreparation::Untouched(source->info().camera));
  ServerChoice choice = options.server;
  choice.interrupt = interrupt;
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::RemoteMapService> service, ConnectTo(choice));
  const auto started = service->StartSession(RequestOf(options, source->info()));
  CAIRN_RETURN_IF_ERROR(WithRemedy(options, started.status()));
  const std::unique_ptr<api::MapSession>& session = *started;
  LivePoseFile live(options.live_poses);
  CAIRN_RETURN_IF_ERROR(live.status());
  api::SessionProgress before;
  AnsweredPoses answered;
  const auto add = [&](const engine::FedFrame& fed) -> absl::StatusOr<std::string> {
    CAIRN_ASSIGN_OR_RETURN(
        const api::SessionAnswer answer,
        session->AddFrame({fed.frame.image, fed.frame.time_ns, static_cast<std::uint32_t>(fed.dropped_before)}));
    answered.Add(answer);
    if (answer.map_from_camera && live.count()) {
      live.Write(answer.time_ns, {answer.component, *answer.map_from_camera, answer.world_from_component});
    }
    if (!options.json) SayWhere(session->progress(), before, source->info().first_time_ns);
    before = session->progress();
    return answer.state == api::SessionState::kInitializing ? answer.reason
                                                            : absl::StrCat(before.keyframes, " keyframes");
  };
  api::SessionSummary summary;
  const auto finish = [&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(summary, session->Finish());
    // What the last frames proved is known only now.
    if (!options.json) SayWhere(session->progress(), before, source->info().first_time_ns);
    return absl::OkStatus();
  };
  FeedSettings settings = ToFeedSettings(options, "mapping");
  settings.feed.stall_s = kStallS;
  const absl::StatusOr<FeedReport> feed = FeedSequence(settings, source.get(), preparation, interrupt, add, finish);
  if (!feed.ok()) {
    return AfterError(feed.status(), {options.trajectory}, Guarded([&] {
                        return WriteTrajectory(options, answered.Last(), answered.last_component(),
                                               answered.last_in_world(), "; as answered, the session did not end well");
                      }));
  }
  const ServedTrajectory trajectory = TrajectoryOf(summary, answered, options.map, *service);
  CAIRN_RETURN_IF_ERROR(WriteTrajectory(options, summary, trajectory));
  PrintServedRun(options, summary, source->info(), *feed, *interrupt, live.count(), answered, trajectory);
  return live.status();
}

}  // namespace cairn::cli

#include "engine/session.h"

#include <algorithm>
#include <atomic>
#include <mutex>
#include <thread>
#include <unordered_map>
#include <utility>
#include <variant>

#include "base/bounded_queue.h"
#include "engine/loop_runner.h"
#include "engine/odometry_runner.h"
#include "mapping/packet_queue.h"

namespace cairn::engine {
namespace {

// Searches for a lost camera come this share of the time since the loss apart.
constexpr double kSeekEvery = 0.1;

SampleReservoir LengthsMs(const std::deque<LoopRunner::Span>& spans) {
  SampleReservoir ms;
  for (const LoopRunner::Span& span : spans) {
    ms.Add(std::chrono::duration<float, std::milli>(span.end - span.begin).count());
  }
  return ms;
}

}  // namespace

absl::Status SessionOptions::Validate() const {
  CAIRN_RETURN_IF_ERROR(odometry.Validate());
  CAIRN_RETURN_IF_ERROR(mapping.Validate());
  CAIRN_RETURN_IF_ERROR(loops.Validate());
  CAIRN_RETURN_IF_ERROR(collinearity.Validate());
  if (threads < 1) return absl::InvalidArgumentError("threads must be at least 1");
  if (packet_queue_limit < 1) return absl::InvalidArgumentError("packet_queue_limit must be at least 1");
  if (seek_after_frames < 0) return absl::InvalidArgumentError("seek_after_frames must not be negative");
  if (mapping_backlog < 1) return absl::InvalidArgumentError("mapping_backlog must be at least 1");
  return absl::OkStatus();
}

class Session::Impl {
 public:
  Impl(const SessionOptions& options, FramePreparation preparation, MapWriter* writer)
      : options_(options),
        preparation_(std::move(preparation)),
        writer_(writer),
        packets_(options.packet_queue_limit),
        collinearity_(options.collinearity),
        backlog_(static_cast<std::size_t>(options.mapping_backlog)) {}

  ~Impl() {
    SetMappingStatus(absl::CancelledError("the session was abandoned"));  // what is queued is not mapped any more
    StopThread();                                                         // first: it may have a word for the odometry
    runner_.reset();
  }

  absl::Status Start(const SessionSource& source, const place::Vocabulary* vocabulary) {
    CAIRN_ASSIGN_OR_RETURN(session_, BeginSession(source, preparation_.pinhole(), !options_.deterministic, writer_));
    if (options_.UsedThreads() > 1) writer_->StoreInBackground();
    const auto commit = [this](map::Delta delta) {
      if (options_.on_change) options_.on_change(delta);
      return writer_->Commit(std::move(delta));
    };
    CAIRN_ASSIGN_OR_RETURN(mapper_, mapping::FeatureMapper::Create(options_.mapping, writer_->Current(), session_.id,
                                                                   session_.camera, vocabulary, commit));
    if (options_.close_loops) {
      CAIRN_ASSIGN_OR_RETURN(loops_, LoopRunner::Create(options_.loops, options_.UsedThreads() > 1));
    }
    if (options_.UsedThreads() > 1) thread_ = std::thread([this] { MapPackets(); });
    OdometryRunnerOptions runner;
    runner.odometry = options_.odometry;
    runner.in_background = options_.UsedThreads() > 2;
    const auto after_mapping = [this](direct::Odometry& odometry) { return HandOver(odometry); };
    CAIRN_ASSIGN_OR_RETURN(runner_, OdometryRunner::Create(runner, preparation_.pinhole(), after_mapping));
    return absl::OkStatus();
  }

  absl::StatusOr<direct::FrameResult> AddFrame(const direct::Frame& frame) {
    CAIRN_RETURN_IF_ERROR(MappingStatus());
    CAIRN_ASSIGN_OR_RETURN(direct::FrameResult result, runner_->AddFrame(frame));
    last_time_ns_ = frame.time_ns;
    if (result.keyframe >= 0) {
      untracked_ = 0;
    } else {
      CAIRN_RETURN_IF_ERROR(SeekIfLost(frame));
    }
    return result;
  }

  const FramePreparation& preparation() const { return preparation_; }

  std::int64_t KeyframesInMap() const { return static_cast<std::int64_t>(writer_->Current()->keyframes().size()); }

  std::vector<FramePose> FramePoses() const { return live_.All(runner_->odometry()).frames; }
  std::optional<SE3> PoseInMap(const direct::FrameResult& frame) const { return live_.Of(frame); }

  absl::StatusOr<SessionReport> Finish() {
    CAIRN_RETURN_IF_ERROR(runner_->Finish());
    packets_.Flush();
    CAIRN_RETURN_IF_ERROR(PassOn());
    StopThread();
    CAIRN_RETURN_IF_ERROR(MappingStatus());
    if (!writer_->file_exists()) {
      const std::string& waited = runner_->waiting_for();
      return absl::FailedPreconditionError(
          absl::StrCat("no map was made: ", waited.empty() ? "there was no keyframe to map" : waited));
    }
    if (loops_) CAIRN_RETURN_IF_ERROR(loops_->Finish(mapper_.get()));
    mapper_->ReviseDirectPoses(DirectPoses());
    CAIRN_RETURN_IF_ERROR(mapper_->Finish());
    const mapping::TrajectoryChoice choice = ChooseTrajectory();
    trajectory_ = {choice.refined, choice.keyframes, choice.collinear, choice.reason};
    live_.Publish(mapper_->map(), mapper_->trajectory(), trajectory_.refined);
    CAIRN_RETURN_IF_ERROR(EndSession(session_.id, last_time_ns_, !options_.deterministic, trajectory_, writer_));
    CAIRN_RETURN_IF_ERROR(writer_->Flush());
    return Report();
  }

 private:
  // Gives the feature module every keyframe whose turn has come. In the thread that maps for the odometry.
  absl::Status HandOver(direct::Odometry& odometry) {
    for (direct::KeyframePacket& packet : odometry.TakePackets()) {
      CAIRN_RETURN_IF_ERROR(packets_.Push(std::move(packet)));
    }
    for (;;) {
      CAIRN_RETURN_IF_ERROR(PassOn());
      const std::optional<std::int64_t> wanted = packets_.Wanted();
      if (!wanted) return absl::OkStatus();
      absl::StatusOr<direct::KeyframePacket> active = odometry.PacketOf(*wanted);
      if (active.ok()) {
        CAIRN_RETURN_IF_ERROR(packets_.Push(*std::move(active)));
      } else {
        packets_.Skip(*wanted);
      }
    }
  }

  // Waits while the feature module is too far behind.
  absl::Status PassOn() {
    while (std::optional<direct::KeyframePacket> packet = packets_.Pop()) {
      if (!thread_.joinable()) {
        CAIRN_RETURN_IF_ERROR(Map(*packet));
      } else if (!backlog_.Push(std::move(*packet))) {
        return absl::CancelledError("the session is ending");
      }
    }
    return absl::OkStatus();
  }

  // A frame without a pose: once in a while the feature module is asked where it is. Never waits for it.
  absl::Status SeekIfLost(const direct::Frame& frame) {
    if (untracked_++ == 0) lost_since_ns_ = next_seek_ns_ = frame.time_ns;
    if (options_.seek_after_frames == 0 || untracked_ < options_.seek_after_frames) return absl::OkStatus();
    if (frame.time_ns < next_seek_ns_ || KeyframesInMap() == 0 || seeking_.exchange(true)) return absl::OkStatus();
    next_seek_ns_ = frame.time_ns + FromSeconds(kSeekEvery * ToSeconds(frame.time_ns - lost_since_ns_));
    if (!thread_.joinable()) return Map(frame);
    if (!backlog_.TryPush(frame)) seeking_ = false;
    return absl::OkStatus();
  }

  // What the feature module has to say of a lost frame goes to the odometry as a message.
  absl::Status Map(const direct::Frame& lost) {
    const auto view = mapper_->Locate(lost);
    seeking_ = false;
    CAIRN_RETURN_IF_ERROR(view.status());
    if (!*view) return absl::OkStatus();
    runner_->GoOnFrom(**view).IgnoreError();  // too few points, or the stream has ended: as good as not found
    return absl::OkStatus();
  }

  // A keyframe, and the frames kept between it and the next.
  absl::Status Map(const direct::KeyframePacket& packet) {
    CAIRN_ASSIGN_OR_RETURN(const mapping::KeyframeReport report, mapper_->Process(packet));
    keyframe_ms_.Add(static_cast<float>(report.times.total_ms));
    keyframe_reports_.push_back(report);
    const bool lost = report.state == mapping::FeatureState::kLost;
    if (lost && !feature_lost_) ++feature_losses_;
    feature_lost_ = lost;
    if (report.inserted) collinearity_.Update(*mapper_->map(), report.keyframe);
    if (loops_) CAIRN_RETURN_IF_ERROR(loops_->AfterPacket(report, mapper_.get()));
    const bool refined = ChooseTrajectory().refined;
    live_.Publish(mapper_->map(), mapper_->trajectory(), refined);
    return absl::OkStatus();
  }

  // The feature module's thread. After an error it drains the queue, so that the odometry is never stuck.
  void MapPackets() {
    while (std::optional<MappingJob> job = backlog_.Pop()) {
      if (!MappingStatus().ok()) continue;
      SetMappingStatus(std::visit([this](const auto& what) { return Map(what); }, *job));
    }
  }

  absl::Status MappingStatus() {
    std::lock_guard lock(status_mutex_);
    return mapping_status_;
  }
  // The first error stays.
  void SetMappingStatus(const absl::Status& status) {
    std::lock_guard lock(status_mutex_);
    mapping_status_.Update(status);
  }

  void StopThread() {
    backlog_.Close();
    if (thread_.joinable()) thread_.join();
  }

  // Packets of keyframes that were still active have poses that changed afterwards; the frames hang on the last ones.
  std::unordered_map<std::int64_t, SE3> DirectPoses() const {
    std::unordered_map<std::int64_t, SE3> poses;
    for (const direct::KeyframePose& keyframe : runner_->odometry().KeyframeTrajectory()) {
      poses[keyframe.keyframe] = keyframe.direct_from_camera;
    }
    return poses;
  }

  mapping::TrajectoryChoice ChooseTrajectory() const {
    return collinearity_.Choose(loops_ && !loops_->loops().empty(), mapper_->lens() && mapper_->lens()->applied);
  }

  SessionReport Report() const {
    const std::shared_ptr<const map::Snapshot> map = writer_->Current();
    SessionReport report;
    report.odometry = runner_->odometry().Statistics();
    report.lens = mapper_->lens();
    report.trajectory = trajectory_;
    PosesInMap poses = live_.All(runner_->odometry());
    report.keyframe_poses = std::move(poses.keyframes);
    report.frame_poses = std::move(poses.frames);
    for (const FramePose& frame : report.frame_poses) report.frames_tracked += frame.map_from_camera ? 1 : 0;
    report.parts = Parts(poses.parts, report.frame_poses);
    report.frames = static_cast<std::int64_t>(report.frame_poses.size());
    report.direct_keyframes = static_cast<std::int64_t>(report.keyframe_poses.size());
    report.keyframes = static_cast<std::int64_t>(map->keyframes().size());
    report.points = static_cast<std::int64_t>(map->points().size());
    report.feature_losses = feature_losses_;
    if (loops_) {
      report.loops = loops_->loops();
      report.loops_rejected = loops_->rejected();
      report.loop_search_ms = loops_->search_ms();
      report.correction_ms = LengthsMs(loops_->corrections());
      report.adjustment_ms = LengthsMs(loops_->adjustments());
      report.frame_ms_correcting = FramesWhileCorrecting();
    }
    report.frame_ms = runner_->frame_ms();
    report.keyframe_ms = keyframe_ms_;
    report.keyframe_reports = keyframe_reports_;
    return report;
  }

  static std::vector<MapPart> Parts(const std::vector<std::vector<KeyframeId>>& linked,
                                    const std::vector<FramePose>& frames) {
    std::vector<MapPart> parts;
    for (const auto& keyframes : linked) parts.push_back({static_cast<std::int64_t>(keyframes.size())});
    for (const FramePose& frame : frames) {
      if (frame.part < 0) continue;
      MapPart& part = parts[static_cast<std::size_t>(frame.part)];
      if (part.frames++ == 0) part.first_ns = frame.time_ns;
      part.last_ns = frame.time_ns;
    }
    return parts;
  }

  SampleReservoir FramesWhileCorrecting() const {
    SampleReservoir during;
    for (const OdometryRunner::TimedFrame& frame : runner_->recent_frames()) {
      const std::chrono::duration<double, std::milli> lasted(frame.ms);
      const auto overlaps = [&](const LoopRunner::Span& span) {
        return frame.begin < span.end && frame.begin + lasted > span.begin;
      };
      if (std::any_of(loops_->corrections().begin(), loops_->corrections().end(), overlaps) ||
          std::any_of(loops_->adjustments().begin(), loops_->adjustments().end(), overlaps)) {
        during.Add(frame.ms);
      }
    }
    return during;
  }

  using MappingJob = std::variant<direct::KeyframePacket, direct::Frame>;  // map this, or look for this lost one

  const SessionOptions options_;
  const FramePreparation preparation_;
  MapWriter* const writer_;
  map::Session session_;
  std::unique_ptr<OdometryRunner> runner_;
  mapping::PacketQueue packets_;  // of the thread that maps for the odometry
  TimeNs last_time_ns_ = 0;
  int untracked_ = 0;  // frames since the last with a pose
  TimeNs lost_since_ns_ = 0;
  TimeNs next_seek_ns_ = 0;
  std::atomic<bool> seeking_ = false;  // a lost frame is with the feature module
  LivePoses live_;

  // Used by the feature module's thread while it runs.
  std::unique_ptr<mapping::FeatureMapper> mapper_;
  std::unique_ptr<LoopRunner> loops_;  // null: loops are not closed
  mapping::CollinearityCounter collinearity_;
  map::ReportedTrajectory trajectory_;  // at the end
  SampleReservoir keyframe_ms_;
  std::vector<mapping::KeyframeReport> keyframe_reports_;
  std::int64_t feature_losses_ = 0;
  bool feature_lost_ = false;

  BoundedQueue<MappingJob> backlog_;
  std::mutex status_mutex_;
  absl::Status mapping_status_;
  std::thread thread_;
};

Session::Session(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Session::~Session() = default;

absl::StatusOr<std::unique_ptr<Session>> Session::Create(const SessionOptions& options, const SessionSource& source,
                                                         const place::Vocabulary* vocabulary, MapWriter* writer) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_ASSIGN_OR_RETURN(FramePreparation preparation, FramePreparation::Create(source));
  auto impl = std::make_unique<Impl>(options, std::move(preparation), writer);
  CAIRN_RETURN_IF_ERROR(impl->Start(source, vocabulary));
  return std::unique_ptr<Session>(new Session(std::move(impl)));
}

absl::StatusOr<direct::FrameResult> Session::AddFrame(const RawFrame& raw) {
  CAIRN_ASSIGN_OR_RETURN(const direct::Frame frame, impl_->preparation().Prepare(raw));
  return impl_->AddFrame(frame);
}
absl::StatusOr<direct::FrameResult> Session::AddFrame(const direct::Frame& frame) { return impl_->AddFrame(frame); }
const FramePreparation& Session::preparation() const { return impl_->preparation(); }
std::int64_t Session::KeyframesInMap() const { return impl_->KeyframesInMap(); }
std::vector<FramePose> Session::FramePoses() const { return impl_->FramePoses(); }
std::optional<SE3> Session::PoseInMap(const direct::FrameResult& frame) const { return impl_->PoseInMap(frame); }
absl::StatusOr<SessionReport> Session::Finish() { return impl_->Finish(); }

}  // namespace cairn::engine

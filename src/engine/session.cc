#include "engine/session.h"

#include <algorithm>
#include <mutex>
#include <optional>
#include <unordered_map>
#include <utility>
#include <variant>

#include "engine/loop_runner.h"
#include "engine/lost_search.h"
#include "engine/mapping_thread.h"
#include "engine/odometry_runner.h"
#include "engine/session_head.h"
#include "engine/session_statistics.h"
#include "mapping/packet_queue.h"

namespace cairn::engine {

absl::Status SessionOptions::Validate() const {
  CAIRN_RETURN_IF_ERROR(odometry.Validate());
  CAIRN_RETURN_IF_ERROR(mapping.Validate());
  CAIRN_RETURN_IF_ERROR(loops.Validate());
  CAIRN_RETURN_IF_ERROR(joins.Validate());
  CAIRN_RETURN_IF_ERROR(collinearity.Validate());
  if (threads < 1) return absl::InvalidArgumentError("threads must be at least 1");
  if (packet_queue_limit < 1) return absl::InvalidArgumentError("packet_queue_limit must be at least 1");
  if (seek_after_frames < 0) return absl::InvalidArgumentError("seek_after_frames must not be negative");
  if (mapping_backlog < 1) return absl::InvalidArgumentError("mapping_backlog must be at least 1");
  return absl::OkStatus();
}

class Session::Impl : public LiveMap::Listener {
 public:
  Impl(const SessionOptions& options, FramePreparation preparation, LiveMap* live)
      : options_(options),
        preparation_(std::move(preparation)),
        live_(live),
        head_(live),
        packets_(options.packet_queue_limit),
        search_(options.seek_after_frames),
        collinearity_(options.collinearity),
        jobs_(static_cast<std::size_t>(options.mapping_backlog), [this](const MappingJob& job) { return Do(job); }) {}

  ~Impl() override {
    jobs_.Abandon();  // first: it may have a word for the odometry
    runner_.reset();
    LiveMap::Editor editor = live_->BeginEdit();
    editor.RemoveListener(this);
  }

  absl::Status Start(const SessionSource& source) {
    if (options_.UsedThreads() > 1) CAIRN_RETURN_IF_ERROR(live_->StoreInBackground());
    {
      const SessionHead::Turn turn(&head_);
      CAIRN_ASSIGN_OR_RETURN(session_, BeginSession(source, preparation_.pinhole(), !options_.deterministic, head_));
      CAIRN_ASSIGN_OR_RETURN(mapper_,
                             mapping::FeatureMapper::Create(options_.mapping, &head_, session_.id, session_.camera));
      LoopRunnerOptions loops;
      loops.loops = options_.loops;
      loops.joins = options_.joins;
      loops.close_loops = options_.close_loops;
      loops.in_background = options_.UsedThreads() > 1;
      loops.record_wall_clock = !options_.deterministic;
      CAIRN_ASSIGN_OR_RETURN(loops_, LoopRunner::Create(loops));
      head_.editor().AddListener(this);
    }
    if (options_.UsedThreads() > 1) CAIRN_RETURN_IF_ERROR(jobs_.Start());
    OdometryRunnerOptions runner;
    runner.odometry = options_.odometry;
    runner.in_background = options_.UsedThreads() > 2;
    const auto after_mapping = [this](direct::Odometry& odometry) { return HandOver(odometry); };
    CAIRN_ASSIGN_OR_RETURN(runner_, OdometryRunner::Create(runner, preparation_.pinhole(), after_mapping));
    return absl::OkStatus();
  }

  absl::StatusOr<direct::FrameResult> AddFrame(const direct::Frame& frame) {
    CAIRN_RETURN_IF_ERROR(jobs_.status());
    CAIRN_ASSIGN_OR_RETURN(direct::FrameResult result, runner_->AddFrame(frame));
    last_time_ns_ = frame.time_ns;
    if (result.keyframe >= 0) {
      search_.Tracked();
    } else if (search_.Untracked(frame.time_ns)) {
      CAIRN_RETURN_IF_ERROR(Seek(frame));
    }
    return result;
  }

  const FramePreparation& preparation() const { return preparation_; }

  std::int64_t KeyframesInMap() const {
    return static_cast<std::int64_t>(live_->Published()->map().keyframes().size());
  }

  Whereabouts Where() const {
    const std::lock_guard lock(where_mutex_);
    return where_;
  }
  std::vector<FramePose> FramePoses() const { return poses_.All(runner_->odometry()).frames; }
  std::optional<LivePose> PoseInMap(const direct::FrameResult& frame) const { return poses_.Of(frame); }

  absl::StatusOr<SessionReport> Finish() {
    CAIRN_RETURN_IF_ERROR(runner_->Finish());
    packets_.Flush();
    CAIRN_RETURN_IF_ERROR(PassOn());
    jobs_.Stop();
    CAIRN_RETURN_IF_ERROR(jobs_.status());
    const SessionHead::Turn turn(&head_);
    if (!mapper_->component()) {
      if (session_.policy == map::SessionPolicy::kExtend) {  // nothing of it is left open in a map that is there
        CAIRN_RETURN_IF_ERROR(EndSession(session_.id, last_time_ns_, !options_.deterministic, std::nullopt, head_));
      }
      const std::string& waited = runner_->waiting_for();
      return absl::FailedPreconditionError(absl::StrCat(
          session_.policy == map::SessionPolicy::kCreate ? "no map was made: " : "nothing was added to the map: ",
          waited.empty() ? "there was no keyframe to map" : waited));
    }
    CAIRN_RETURN_IF_ERROR(loops_->Finish(head_));
    mapper_->ReviseDirectPoses(DirectPoses());
    CAIRN_RETURN_IF_ERROR(mapper_->Finish());
    const mapping::TrajectoryChoice choice = ChooseTrajectory();
    trajectory_ = {choice.refined, choice.keyframes, choice.collinear, choice.reason};
    poses_.Publish(mapper_->map(), mapper_->trajectory(), trajectory_.refined);
    CAIRN_RETURN_IF_ERROR(EndSession(session_.id, last_time_ns_, !options_.deterministic, trajectory_, head_));
    CAIRN_RETURN_IF_ERROR(live_->Flush());
    return Report();
  }

  // In the thread of whoever changes the map, while it has the head.
  void OnChange(const tracking::MapView& before, const map::Delta& delta,
                const std::shared_ptr<const tracking::MapView>& after, const mapping::KeyframeScales& scales) override {
    mapper_->OnChange(before, delta, after, scales);
    if (!scales.empty()) loops_->OnCorrection();
  }

 private:
  using MappingJob = std::variant<direct::KeyframePacket, direct::Frame>;  // map this, or look for this lost one

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
      CAIRN_RETURN_IF_ERROR(jobs_.Push(*std::move(packet)));
    }
    return absl::OkStatus();
  }

  // The feature module is asked where the frame is. Never waits for it.
  absl::Status Seek(const direct::Frame& frame) {
    if (KeyframesInMap() == 0) {
      search_.Answered();
      return absl::OkStatus();
    }
    if (!jobs_.in_background()) return jobs_.Push(frame);
    if (!jobs_.TryPush(frame)) search_.Answered();
    return absl::OkStatus();
  }

  absl::Status Do(const MappingJob& job) {
    const SessionHead::Turn turn(&head_);
    return std::visit([this](const auto& what) { return Map(what); }, job);
  }

  // What the feature module has to say of a lost frame goes to the odometry as a message.
  absl::Status Map(const direct::Frame& lost) {
    const auto found = mapper_->Locate(lost);
    search_.Answered();
    CAIRN_RETURN_IF_ERROR(found.status());
    if (!*found) return absl::OkStatus();
    NoteSeen(lost.time_ns, (*found)->component);
    runner_->GoOnFrom((*found)->view).IgnoreError();  // too few points, or the stream has ended: as good as not found
    return absl::OkStatus();
  }

  // A keyframe, and the frames kept between it and the next.
  absl::Status Map(const direct::KeyframePacket& packet) {
    CAIRN_ASSIGN_OR_RETURN(const mapping::KeyframeReport report, mapper_->Process(packet));
    statistics_.Add(report);
    if (report.inserted) collinearity_.Update(*mapper_->map(), report.keyframe);
    const std::size_t joins = loops_->joins().size();
    CAIRN_RETURN_IF_ERROR(loops_->AfterPacket(report, head_));
    mapper_->InsertEach(loops_->ExpectsJoin());
    if (loops_->joins().size() > joins) NoteJoin(report.time_ns, loops_->joins().back());
    const bool refined = ChooseTrajectory().refined;
    poses_.Publish(mapper_->map(), mapper_->trajectory(), refined);
    const std::lock_guard lock(where_mutex_);
    where_.component = mapper_->component();
    return absl::OkStatus();
  }

  // An image of this session was found in a component that others have made.
  void NoteSeen(TimeNs time_ns, ComponentId component) {
    const std::lock_guard lock(where_mutex_);
    if (where_.located || mapper_->map()->component(component).session == session_.id) return;
    where_.located = LocatedAt{time_ns, component};
  }

  void NoteJoin(TimeNs time_ns, const mapping::JoinReport& join) {
    join_times_ns_.push_back(time_ns);
    const ComponentId other = join.into == mapper_->component() ? join.seen_in : join.into;
    const bool others = mapper_->map()->component(join.into).session != session_.id ||
                        mapper_->map()->component(join.component).session != session_.id;
    if (!others) return;
    NoteSeen(time_ns, other);
    const std::lock_guard lock(where_mutex_);
    if (!where_.joined_ns) where_.joined_ns = time_ns;
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
    return collinearity_.Choose(!loops_->loops().empty() || !loops_->joins().empty(),
                                mapper_->lens() && mapper_->lens()->applied);
  }

  SessionReport Report() const {
    const std::shared_ptr<const map::Snapshot> published = live_->Published()->snapshot();
    const map::Snapshot& map = *published;
    SessionReport report;
    report.session = session_.id;
    report.odometry = runner_->odometry().Statistics();
    report.lens = mapper_->lens();
    report.trajectory = trajectory_;
    PosesInMap poses = poses_.All(runner_->odometry());
    report.keyframe_poses = std::move(poses.keyframes);
    report.frame_poses = std::move(poses.frames);
    for (const FramePose& frame : report.frame_poses) report.frames_tracked += frame.map_from_camera ? 1 : 0;
    report.components = SharesOf(map, report.frame_poses);
    report.component = mapper_->component();
    report.result = map.sessions().at(session_.id).result;
    const Whereabouts where = Where();
    if (where.joined_ns) report.located = where.located;
    report.join_times_ns = join_times_ns_;
    report.frames = static_cast<std::int64_t>(report.frame_poses.size());
    report.direct_keyframes = static_cast<std::int64_t>(report.keyframe_poses.size());
    report.keyframes = static_cast<std::int64_t>(map.keyframes().size());
    report.points = static_cast<std::int64_t>(map.points().size());
    statistics_.Fill(*loops_, *runner_, &report);
    return report;
  }

  const SessionOptions options_;
  const FramePreparation preparation_;
  LiveMap* const live_;
  SessionHead head_;
  map::Session session_;
  std::unique_ptr<OdometryRunner> runner_;
  mapping::PacketQueue packets_;  // of the thread that maps for the odometry
  TimeNs last_time_ns_ = 0;
  LostSearch search_;
  LivePoses poses_;

  // Used while this session has the head.
  std::unique_ptr<mapping::FeatureMapper> mapper_;
  std::unique_ptr<LoopRunner> loops_;
  mapping::CollinearityCounter collinearity_;
  map::ReportedTrajectory trajectory_;  // at the end
  SessionStatistics statistics_;
  std::vector<TimeNs> join_times_ns_;

  mutable std::mutex where_mutex_;
  Whereabouts where_;

  MappingThread<MappingJob> jobs_;
};

Session::Session(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Session::~Session() = default;

absl::StatusOr<std::unique_ptr<Session>> Session::Create(const SessionOptions& options, const SessionSource& source,
                                                         LiveMap* map) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_ASSIGN_OR_RETURN(FramePreparation preparation, FramePreparation::Create(source));
  auto impl = std::make_unique<Impl>(options, std::move(preparation), map);
  CAIRN_RETURN_IF_ERROR(impl->Start(source));
  return std::unique_ptr<Session>(new Session(std::move(impl)));
}

absl::StatusOr<direct::FrameResult> Session::AddFrame(const RawFrame& raw) {
  CAIRN_ASSIGN_OR_RETURN(const direct::Frame frame, impl_->preparation().Prepare(raw));
  return impl_->AddFrame(frame);
}
absl::StatusOr<direct::FrameResult> Session::AddFrame(const direct::Frame& frame) { return impl_->AddFrame(frame); }
const FramePreparation& Session::preparation() const { return impl_->preparation(); }
std::int64_t Session::KeyframesInMap() const { return impl_->KeyframesInMap(); }
Session::Whereabouts Session::Where() const { return impl_->Where(); }
std::vector<FramePose> Session::FramePoses() const { return impl_->FramePoses(); }
std::optional<LivePose> Session::PoseInMap(const direct::FrameResult& frame) const { return impl_->PoseInMap(frame); }
absl::StatusOr<SessionReport> Session::Finish() { return impl_->Finish(); }

}  // namespace cairn::engine

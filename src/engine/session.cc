#include "engine/session.h"

#include <optional>
#include <utility>
#include <variant>

#include "absl/strings/str_format.h"
#include "engine/lost_search.h"
#include "engine/mapping_thread.h"
#include "engine/odometry_runner.h"
#include "engine/packet_hand_over.h"
#include "engine/session_head.h"
#include "engine/session_mapper.h"
#include "engine/session_statistics.h"

namespace cairn::engine {

// Brings together what works for a session: the odometry's runner, the hand-over of its keyframes, the thread of the
// feature module, and the search for frames without a pose.
class Session::Impl {
 public:
  Impl(const SessionOptions& options, FramePreparation preparation, LiveMap* live)
      : options_(options),
        preparation_(std::move(preparation)),
        live_(live),
        head_(live),
        search_(options.seek_after_frames),
        hand_over_(options.packet_queue_limit,
                   [this](direct::KeyframePacket packet) { return jobs_.Push(std::move(packet)); }),
        jobs_(
            static_cast<std::size_t>(options.mapping_backlog), [this](const MappingJob& job) { return Do(job); },
            [this] { return MergePart(); }) {}

  ~Impl() {
    jobs_.Abandon();  // first: it may have a word for the odometry
    runner_.reset();
    LiveMap::Editor editor = live_->BeginEdit();
    editor.RemoveListener(mapper_.get());
  }

  absl::Status Start(const SessionSource& source) {
    if (options_.UsedThreads() > 1) CAIRN_RETURN_IF_ERROR(live_->StoreInBackground());
    {
      const SessionHead::Turn turn(&head_);
      CAIRN_ASSIGN_OR_RETURN(session_, BeginSession(source, preparation_.pinhole(), !options_.deterministic, head_));
      CAIRN_ASSIGN_OR_RETURN(mapper_, SessionMapper::Create(options_, &head_, session_));
      head_.editor().AddListener(mapper_.get());
    }
    if (options_.UsedThreads() > 1) CAIRN_RETURN_IF_ERROR(jobs_.Start());
    OdometryRunnerOptions runner;
    runner.odometry = options_.odometry;
    runner.in_background = options_.UsedThreads() > 2;
    const auto after_mapping = [this](direct::Odometry& odometry) { return hand_over_.Take(odometry); };
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
  SessionId id() const { return session_.id; }

  std::int64_t KeyframesInMap() const {
    return static_cast<std::int64_t>(live_->Published()->map().keyframes().size());
  }

  Whereabouts Where() const { return mapper_->Where(); }
  std::vector<FramePose> FramePoses() const { return mapper_->poses().All(runner_->odometry()).frames; }
  std::optional<LivePose> PoseInMap(const direct::FrameResult& frame) const { return mapper_->poses().Of(frame); }

  absl::StatusOr<OdometryReport> FinalOdometry() const { return ReportOdometry(*runner_); }

  absl::StatusOr<SessionReport> Finish() {
    CAIRN_RETURN_IF_ERROR(runner_->Finish());
    CAIRN_RETURN_IF_ERROR(hand_over_.Finish());
    jobs_.Stop();
    CAIRN_RETURN_IF_ERROR(jobs_.status());
    CAIRN_RETURN_IF_ERROR(MergeAdjustment());
    const SessionHead::Turn turn(&head_);
    if (!mapper_->HasMapped()) return EndWithoutMap();
    CAIRN_RETURN_IF_ERROR(mapper_->Finish(runner_->odometry()));
    CAIRN_RETURN_IF_ERROR(
        EndSession(session_.id, last_time_ns_, !options_.deterministic, mapper_->trajectory(), head_));
    CAIRN_RETURN_IF_ERROR(live_->Flush());
    return Report();
  }

 private:
  using MappingJob = std::variant<direct::KeyframePacket, direct::Frame>;  // map this, or look for this lost one

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

  // In the thread of the feature module.
  absl::Status Do(const MappingJob& job) {
    const SessionHead::Turn turn(&head_);
    if (const auto* packet = std::get_if<direct::KeyframePacket>(&job)) return mapper_->MapKeyframe(*packet);
    return LocateLost(std::get<direct::Frame>(job));
  }

  // In turns of their own: others who change the map have theirs between.
  absl::StatusOr<bool> MergePart() {
    const SessionHead::Turn turn(&head_);
    return mapper_->MergePart();
  }

  // Once there are no jobs any more.
  absl::Status MergeAdjustment() {
    mapper_->WaitForAdjustment();
    for (;;) {
      CAIRN_ASSIGN_OR_RETURN(const bool more, MergePart());
      if (!more) return absl::OkStatus();
    }
  }

  // What the feature module has to say of a lost frame goes to the odometry as a message.
  absl::Status LocateLost(const direct::Frame& lost) {
    absl::StatusOr<std::optional<direct::KnownView>> view = mapper_->LocateLost(lost);
    search_.Answered();
    CAIRN_RETURN_IF_ERROR(view.status());
    if (!*view) return absl::OkStatus();
    runner_->GoOnFrom(**std::move(view))
        .IgnoreError();  // too few points, or the stream has ended: as good as not found
    return absl::OkStatus();
  }

  absl::Status EndWithoutMap() {
    if (session_.policy == map::SessionPolicy::kExtend) {  // nothing of it is left open in a map that is there
      CAIRN_RETURN_IF_ERROR(EndSession(session_.id, last_time_ns_, !options_.deterministic, std::nullopt, head_));
    }
    return absl::FailedPreconditionError(absl::StrCat(
        session_.policy == map::SessionPolicy::kCreate ? "no map was made: " : "nothing was added to the map: ",
        WhyNoMap()));
  }

  // The stage that did not begin, and what it says.
  std::string WhyNoMap() const {
    const absl::StatusOr<OdometryReport> odometry = FinalOdometry();
    if (!odometry.ok()) return std::string(odometry.status().message());
    return absl::StrFormat("the odometry tracked %d of %d frames, with %d keyframes, but %s", odometry->frames_tracked,
                           odometry->frames, odometry->keyframe_poses.size(), mapper_->WhyNoMap());
  }

  SessionReport Report() const {
    const std::shared_ptr<const map::Snapshot> published = live_->Published()->snapshot();
    const map::Snapshot& map = *published;
    SessionReport report;
    report.session = session_.id;
    report.odometry = runner_->odometry().Statistics();
    mapper_->Fill(*runner_, &report);
    for (const FramePose& frame : report.frame_poses) report.frames_tracked += frame.map_from_camera ? 1 : 0;
    report.components = SharesOf(map, report.frame_poses);
    report.result = map.sessions().at(session_.id).result;
    report.frames = static_cast<std::int64_t>(report.frame_poses.size());
    report.direct_keyframes = static_cast<std::int64_t>(report.keyframe_poses.size());
    report.keyframes = static_cast<std::int64_t>(map.keyframes().size());
    report.points = static_cast<std::int64_t>(map.points().size());
    return report;
  }

  const SessionOptions options_;
  const FramePreparation preparation_;
  LiveMap* const live_;
  SessionHead head_;
  map::Session session_;
  std::unique_ptr<SessionMapper> mapper_;
  std::unique_ptr<OdometryRunner> runner_;
  TimeNs last_time_ns_ = 0;
  LostSearch search_;
  PacketHandOver hand_over_;
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
SessionId Session::id() const { return impl_->id(); }
std::int64_t Session::KeyframesInMap() const { return impl_->KeyframesInMap(); }
Whereabouts Session::Where() const { return impl_->Where(); }
std::vector<FramePose> Session::FramePoses() const { return impl_->FramePoses(); }
std::optional<LivePose> Session::PoseInMap(const direct::FrameResult& frame) const { return impl_->PoseInMap(frame); }
absl::StatusOr<SessionReport> Session::Finish() { return impl_->Finish(); }
absl::StatusOr<OdometryReport> Session::FinalOdometry() const { return impl_->FinalOdometry(); }

}  // namespace cairn::engine

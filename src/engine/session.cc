#include "engine/session.h"

#include <chrono>
#include <mutex>
#include <thread>
#include <utility>

#include "base/bounded_queue.h"
#include "engine/loop_runner.h"
#include "mapping/packet_queue.h"

namespace cairn::engine {
namespace {

using Clock = std::chrono::steady_clock;

float MillisecondsSince(Clock::time_point start) {
  return std::chrono::duration<float, std::milli>(Clock::now() - start).count();
}

}  // namespace

absl::Status SessionOptions::Validate() const {
  CAIRN_RETURN_IF_ERROR(odometry.Validate());
  CAIRN_RETURN_IF_ERROR(mapping.Validate());
  CAIRN_RETURN_IF_ERROR(loops.Validate());
  if (packet_queue_limit < 1) return absl::InvalidArgumentError("packet_queue_limit must be at least 1");
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
        backlog_(static_cast<std::size_t>(options.mapping_backlog)) {}

  ~Impl() { StopThread(); }

  absl::Status Start(const SessionSource& source, const place::Vocabulary* vocabulary) {
    CAIRN_ASSIGN_OR_RETURN(odometry_, direct::Odometry::Create(options_.odometry, preparation_.pinhole()));
    CAIRN_ASSIGN_OR_RETURN(session_, BeginSession(source, preparation_.pinhole(), !options_.deterministic, writer_));
    const auto commit = [this](map::Delta delta) { return writer_->Commit(delta); };
    CAIRN_ASSIGN_OR_RETURN(mapper_, mapping::FeatureMapper::Create(options_.mapping, writer_->Current(), session_.id,
                                                                   session_.camera, vocabulary, commit));
    if (options_.close_loops) {
      CAIRN_ASSIGN_OR_RETURN(loops_, LoopRunner::Create(options_.loops, !options_.deterministic));
    }
    if (!options_.deterministic) thread_ = std::thread([this] { MapPackets(); });
    return absl::OkStatus();
  }

  absl::StatusOr<direct::FrameResult> AddFrame(const RawFrame& raw) {
    CAIRN_RETURN_IF_ERROR(MappingStatus());
    const Clock::time_point start = Clock::now();
    CAIRN_ASSIGN_OR_RETURN(const direct::Frame frame, preparation_.Prepare(raw));
    CAIRN_ASSIGN_OR_RETURN(direct::FrameResult result, odometry_->Process(frame));
    frame_ms_.push_back(MillisecondsSince(start));
    last_time_ns_ = raw.time_ns;
    if (result.state == direct::TrackingState::kInitializing && !result.message.empty()) waiting_for_ = result.message;
    CAIRN_RETURN_IF_ERROR(HandOver());
    return result;
  }

  std::int64_t KeyframesInMap() const { return static_cast<std::int64_t>(writer_->Current()->keyframes().size()); }

  absl::StatusOr<SessionReport> Finish() {
    odometry_->Finish();
    CAIRN_RETURN_IF_ERROR(HandOver());
    packets_.Flush();
    CAIRN_RETURN_IF_ERROR(HandOver());
    StopThread();
    CAIRN_RETURN_IF_ERROR(MappingStatus());
    if (!writer_->file_exists()) {
      return absl::FailedPreconditionError(
          absl::StrCat("no map was made: ", waiting_for_.empty() ? "there was no keyframe to map" : waiting_for_));
    }
    if (loops_) CAIRN_RETURN_IF_ERROR(loops_->Finish(mapper_.get()));
    CAIRN_RETURN_IF_ERROR(mapper_->Finish());
    CAIRN_RETURN_IF_ERROR(EndSession(session_, last_time_ns_, !options_.deterministic, writer_));
    return Report();
  }

 private:
  // Gives the feature module every keyframe whose turn has come.
  absl::Status HandOver() {
    for (direct::KeyframePacket& packet : odometry_->TakePackets()) {
      CAIRN_RETURN_IF_ERROR(packets_.Push(std::move(packet)));
    }
    for (;;) {
      if (std::optional<direct::KeyframePacket> packet = packets_.Pop()) {
        if (options_.deterministic) {
          CAIRN_RETURN_IF_ERROR(MapPacket(*packet));
        } else {
          backlog_.Push(std::move(*packet));
        }
      } else if (const std::optional<std::int64_t> wanted = packets_.Wanted()) {
        absl::StatusOr<direct::KeyframePacket> active = odometry_->PacketOf(*wanted);
        if (active.ok()) {
          CAIRN_RETURN_IF_ERROR(packets_.Push(*std::move(active)));
        } else {
          packets_.Skip(*wanted);
        }
      } else {
        return absl::OkStatus();
      }
    }
  }

  absl::Status MapPacket(const direct::KeyframePacket& packet) {
    CAIRN_ASSIGN_OR_RETURN(const mapping::KeyframeReport report, mapper_->Process(packet));
    keyframe_ms_.push_back(static_cast<float>(report.times.total_ms));
    const bool lost = report.state == mapping::FeatureState::kLost;
    if (lost && !feature_lost_) ++feature_losses_;
    feature_lost_ = lost;
    return loops_ ? loops_->AfterPacket(report, mapper_.get()) : absl::OkStatus();
  }

  // The feature module's thread. After an error it drains the queue, so that the odometry is never stuck.
  void MapPackets() {
    while (std::optional<direct::KeyframePacket> packet = backlog_.Pop()) {
      if (!MappingStatus().ok()) continue;
      if (absl::Status status = MapPacket(*packet); !status.ok()) {
        std::lock_guard lock(status_mutex_);
        mapping_status_ = status;
      }
    }
  }

  absl::Status MappingStatus() {
    std::lock_guard lock(status_mutex_);
    return mapping_status_;
  }

  void StopThread() {
    backlog_.Close();
    if (thread_.joinable()) thread_.join();
  }

  SessionReport Report() const {
    const std::shared_ptr<const map::Snapshot> map = writer_->Current();
    SessionReport report;
    report.odometry = odometry_->Statistics();
    report.keyframe_poses = mapper_->Trajectory(*map);
    for (const direct::FrameResult& frame : odometry_->FrameResults()) {
      const std::optional<SE3> pose = mapping::FramePose(report.keyframe_poses, frame);
      report.frame_poses.push_back({frame.index, frame.time_ns, frame.state, pose});
      if (pose) ++report.frames_tracked;
    }
    report.frames = static_cast<std::int64_t>(report.frame_poses.size());
    report.direct_keyframes = static_cast<std::int64_t>(report.keyframe_poses.size());
    report.keyframes = static_cast<std::int64_t>(map->keyframes().size());
    report.points = static_cast<std::int64_t>(map->points().size());
    report.feature_losses = feature_losses_;
    if (loops_) {
      report.loops = loops_->loops();
      report.loop_search_ms = loops_->search_ms();
    }
    report.frame_ms = frame_ms_;
    report.keyframe_ms = keyframe_ms_;
    return report;
  }

  const SessionOptions options_;
  const FramePreparation preparation_;
  MapWriter* const writer_;
  map::Session session_;
  std::unique_ptr<direct::Odometry> odometry_;
  mapping::PacketQueue packets_;
  TimeNs last_time_ns_ = 0;
  std::string waiting_for_;
  std::vector<float> frame_ms_;

  // Used by the feature module's thread while it runs.
  std::unique_ptr<mapping::FeatureMapper> mapper_;
  std::unique_ptr<LoopRunner> loops_;  // null: loops are not closed
  std::vector<float> keyframe_ms_;
  std::int64_t feature_losses_ = 0;
  bool feature_lost_ = false;

  BoundedQueue<direct::KeyframePacket> backlog_;
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

absl::StatusOr<direct::FrameResult> Session::AddFrame(const RawFrame& frame) { return impl_->AddFrame(frame); }
std::int64_t Session::KeyframesInMap() const { return impl_->KeyframesInMap(); }
absl::StatusOr<SessionReport> Session::Finish() { return impl_->Finish(); }

}  // namespace cairn::engine

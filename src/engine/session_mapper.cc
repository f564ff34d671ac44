#include "engine/session_mapper.h"

#include <utility>

namespace cairn::engine {

absl::StatusOr<std::unique_ptr<SessionMapper>> SessionMapper::Create(const SessionOptions& options, SessionHead* head,
                                                                     const map::Session& session) {
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<mapping::FeatureMapper> mapper,
                         mapping::FeatureMapper::Create(options.mapping, head, session.id, session.camera));
  LoopRunnerOptions loop_options;
  loop_options.loops = options.loops;
  loop_options.joins = options.joins;
  loop_options.close_loops = options.close_loops;
  loop_options.in_background = options.UsedThreads() > 1;
  loop_options.record_wall_clock = !options.deterministic;
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<LoopRunner> loops, LoopRunner::Create(loop_options));
  return std::unique_ptr<SessionMapper>(
      new SessionMapper(options, head, session.id, std::move(mapper), std::move(loops)));
}

SessionMapper::SessionMapper(const SessionOptions& options, SessionHead* head, SessionId session,
                             std::unique_ptr<mapping::FeatureMapper> mapper, std::unique_ptr<LoopRunner> loops)
    : head_(head),
      mapper_(std::move(mapper)),
      loops_(std::move(loops)),
      collinearity_(options.collinearity),
      memory_(options.UsedMemory()),
      where_(session) {}

absl::Status SessionMapper::MapKeyframe(const direct::KeyframePacket& packet) {
  CAIRN_ASSIGN_OR_RETURN(const mapping::KeyframeReport report, mapper_->Process(packet));
  statistics_.Add(report);
  if (report.inserted) collinearity_.Update(*mapper_->map(), report.keyframe);
  const std::size_t joins = loops_->joins().size();
  CAIRN_RETURN_IF_ERROR(loops_->AfterPacket(report, *head_));
  mapper_->InsertEach(loops_->ExpectsJoin());
  if (loops_->joins().size() > joins) {
    where_.Joined(report.time_ns, loops_->joins().back(), mapper_->component(), *mapper_->map());
  }
  poses_.Publish(mapper_->map(), mapper_->trajectory(), Memory());
  where_.IsIn(mapper_->component());
  return absl::OkStatus();
}

absl::StatusOr<std::optional<direct::KnownView>> SessionMapper::LocateLost(const direct::Frame& lost) {
  CAIRN_ASSIGN_OR_RETURN(std::optional<mapping::FeatureMapper::Found> found, mapper_->Locate(lost));
  if (!found) return std::nullopt;
  where_.Saw(lost.time_ns, found->component, *mapper_->map());
  return std::move(found->view);
}

absl::Status SessionMapper::Finish(const direct::Odometry& odometry) {
  std::unordered_map<std::int64_t, SE3> direct_poses;
  for (const direct::KeyframePose& keyframe : odometry.KeyframeTrajectory()) {
    direct_poses[keyframe.keyframe] = keyframe.direct_from_camera;
  }
  mapper_->ReviseDirectPoses(direct_poses);
  CAIRN_RETURN_IF_ERROR(mapper_->Finish());
  std::vector<mapping::Stretch> direct;
  const std::vector<mapping::KeyframeTrajectory::Entry>& entries = mapper_->trajectory().entries();
  if (Memory()) direct = mapping::DirectStretches(entries, *mapper_->map(), memory_);
  const mapping::TrajectoryChoice choice = mapping::ChooseTrajectory(entries, direct, LoopClosed(), LensCorrected());
  trajectory_ = {choice.refined, collinearity_.keyframes(), collinearity_.collinear(), choice.reason};
  poses_.Publish(mapper_->map(), mapper_->trajectory(), Memory());
  return absl::OkStatus();
}

void SessionMapper::OnChange(const tracking::MapView& before, const map::Delta& delta,
                             const std::shared_ptr<const tracking::MapView>& after,
                             const mapping::KeyframeScales& scales) {
  mapper_->OnChange(before, delta, after, scales);
  if (!scales.empty()) loops_->OnCorrection();
}

std::optional<mapping::MapMemoryOptions> SessionMapper::Memory() const {
  if (LoopClosed() || LensCorrected()) return std::nullopt;
  return memory_;
}

void SessionMapper::Fill(const OdometryRunner& runner, SessionReport* report) const {
  report->component = mapper_->component();
  report->lens = mapper_->lens();
  report->trajectory = trajectory_;
  PosesInMap poses = poses_.All(runner.odometry(), /*assess=*/true);
  report->keyframe_poses = std::move(poses.keyframes);
  report->frame_poses = std::move(poses.frames);
  report->quality = std::move(poses.quality);
  const Whereabouts where = Where();
  if (where.joined_ns) report->located = where.located;
  report->join_times_ns = where_.join_times_ns();
  statistics_.Fill(*loops_, runner, report);
}

}  // namespace cairn::engine

// What a session does in the map: the feature module, the search for loops and joins after each of its keyframes, which
// of the two trajectories is reported, and what others ask for meanwhile (poses, whereabouts).
//
// Everything changes while this session has the head; poses() and Where() answer in any thread.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <unordered_map>

#include "base/status.h"
#include "direct/odometry.h"
#include "direct/packet.h"
#include "engine/live_map.h"
#include "engine/live_poses.h"
#include "engine/loop_runner.h"
#include "engine/odometry_runner.h"
#include "engine/session_head.h"
#include "engine/session_options.h"
#include "engine/session_report.h"
#include "engine/session_statistics.h"
#include "engine/whereabouts.h"
#include "map/entities.h"
#include "mapping/collinearity.h"
#include "mapping/feature_mapper.h"
#include "mapping/map_memory.h"

namespace cairn::engine {

class SessionMapper final : public LiveMap::Listener {
 public:
  // `head` must outlive it. To be made a listener of the map, in the same turn.
  static absl::StatusOr<std::unique_ptr<SessionMapper>> Create(const SessionOptions& options, SessionHead* head,
                                                               const map::Session& session);

  // A keyframe, and the frames kept between it and the next.
  absl::Status MapKeyframe(const direct::KeyframePacket& packet);
  // What the map knows of the view of a frame without a pose, if it is found there.
  absl::StatusOr<std::optional<direct::KnownView>> LocateLost(const direct::Frame& lost);
  // A part of an adjustment that waits to be merged; true if there are more.
  absl::StatusOr<bool> MergePart() { return loops_->MergePart(*head_); }
  // After the last keyframe: until MergePart() can merge all there is. Needs no head.
  void WaitForAdjustment() { loops_->WaitForAdjustment(); }
  // After the last keyframe, and all that was to be merged. Packets of keyframes that were still active have poses that
  // changed afterwards: `odometry` has the last ones, which the frames hang on.
  absl::Status Finish(const direct::Odometry& odometry);

  // Of whoever changes the map, while it has the head.
  void OnChange(const tracking::MapView& before, const map::Delta& delta,
                const std::shared_ptr<const tracking::MapView>& after, const mapping::KeyframeScales& scales) override;

  // Why no keyframe is in the map, for people: "the feature module could not start: ...".
  std::string WhyNoMap() const { return statistics_.WhyNoMap(); }
  bool HasMapped() const { return mapper_->component().valid(); }
  // Which trajectory is reported (mapping/map_memory.h); once finished.
  const map::ReportedTrajectory& trajectory() const { return trajectory_; }
  // What belongs into the report of the session; once finished.
  void Fill(const OdometryRunner& runner, SessionReport* report) const;

  const LivePoses& poses() const { return poses_; }
  Whereabouts Where() const { return where_.Now(); }

 private:
  SessionMapper(const SessionOptions& options, SessionHead* head, SessionId session,
                std::unique_ptr<mapping::FeatureMapper> mapper, std::unique_ptr<LoopRunner> loops);
  bool LoopClosed() const { return !loops_->loops().empty() || !loops_->joins().empty(); }
  bool LensCorrected() const { return mapper_->lens() && mapper_->lens()->applied; }
  // As far as the odometry's trajectory may be reported; none where it knows less than the map.
  std::optional<mapping::MapMemoryOptions> Memory() const;

  SessionHead* const head_;
  const std::unique_ptr<mapping::FeatureMapper> mapper_;
  const std::unique_ptr<LoopRunner> loops_;
  mapping::CollinearityCounter collinearity_;
  const mapping::MapMemoryOptions memory_;
  map::ReportedTrajectory trajectory_;
  SessionStatistics statistics_;
  LivePoses poses_;
  WhereaboutsNotes where_;
};

}  // namespace cairn::engine

// Going on from a view that somebody else knows: a lost odometry begins a new segment in a frame whose points have
// known depths, without waiting for parallax. The frames that were lost around it are tracked afterwards.
#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "direct/odometry_impl.h"

namespace cairn::direct {

absl::Status Odometry::Impl::GoOnFrom(KnownView view) {
  for (const PacketPoint& point : view.points) {
    if (!(point.inverse_depth > 0.0f) || !std::isfinite(point.inverse_depth)) {
      return absl::InvalidArgumentError("a known view needs points with positive, finite inverse depths");
    }
  }
  if (view.points.size() < FirstWindow::kMinKnownPoints) {
    return absl::InvalidArgumentError(absl::StrCat("a known view needs at least ", FirstWindow::kMinKnownPoints,
                                                   " points, it has ", view.points.size()));
  }
  std::lock_guard lock(mutex_);
  if (finished_) return absl::FailedPreconditionError("the odometry is finished");
  Job job;
  job.known = std::make_shared<const KnownView>(std::move(view));
  jobs_.push_back(std::move(job));
  return absl::OkStatus();
}

// The frames without a pose since the last tracked one, oldest first: kept already, or still queued. Empty if a
// frame has been tracked meanwhile. track_mutex_ held.
std::vector<RetainedFrame> Odometry::Impl::WaitingFrames() const {
  std::lock_guard lock(mutex_);
  if (mode_ == Mode::kTracking && recent_.lost_frames == 0) return {};
  std::vector<RetainedFrame> waiting;
  for (const RetainedFrame& retained : retained_.Waiting()) {
    if (poses_.frames()[retained.position].keyframe < 0) waiting.push_back(retained);
  }
  for (const Job& job : jobs_) {
    if (job.data) return {};
    if (!job.known) waiting.push_back({job.frame, job.position});
  }
  return waiting;
}

void Odometry::Impl::BeginAt(const KnownView& view) {
  const std::lock_guard track_lock(track_mutex_);
  const std::vector<RetainedFrame> waiting = WaitingFrames();
  const auto here = std::find_if(waiting.begin(), waiting.end(), [&](const RetainedFrame& retained) {
    return retained.frame.index == view.frame_index;
  });
  if (here == waiting.end()) return;
  FlushWindow();
  retained_.ClearLost();
  const SegmentNumbers numbers = NextNumbers();
  if (!first_window_.FromKnownView(here->frame, view, numbers)) {
    retained_.SetLost(waiting.begin(), waiting.end());  // for a start by motion
    std::lock_guard lock(mutex_);
    jobs_.clear();
    untracked_jobs_ = 1;
    mode_ = Mode::kStarting;
  } else {
    {
      std::lock_guard lock(mutex_);
      poses_.AddKeyframe({numbers.keyframe, numbers.segment, here->frame.index, here->frame.time_ns, SE3(), true});
    }
    const std::shared_ptr<const TrackingReference> reference = BuildReference(0);
    SetReference(reference);
    StoreRetracked(here->position, reference->keyframe, SE3(), 1.0);
    recent_.BeginSegment();
    TrackBackwards(std::vector<RetainedFrame>(waiting.begin(), here), *reference);
    {
      std::lock_guard lock(mutex_);
      poses_.Interpolate(waiting.front().position, here->position);
    }
    recent_.light = reference->light;
    retained_.SetLost(here + 1, waiting.end());
    std::lock_guard lock(mutex_);
    jobs_.clear();
    untracked_jobs_ = 1;
    mode_ = Mode::kTracking;
    keyframe_queued_ = false;
    keyframe_awaited_ = false;
    start_message_.clear();
    ++statistics_.segments;
    ++statistics_.recoveries;
    // Whoever knows the view can say at once where the segment is.
    packets_.push_back(MakePacket(window_.keyframe(0), true));
  }
  RequeueLost();
}

// The frames since the last tracked one wait for the next start, before all that were handed over since.
void Odometry::Impl::RequeueLost() {
  std::lock_guard lock(mutex_);
  for (auto it = retained_.lost().rbegin(); it != retained_.lost().rend(); ++it) {
    Job job;
    job.frame = it->frame;
    job.position = it->position;
    jobs_.insert(jobs_.begin(), std::move(job));
    ++untracked_jobs_;
  }
  --untracked_jobs_;  // the frame that gave up is counted and among them
  retained_.ClearLost();
}

// Frames before the first keyframe of a segment, newest last: backwards against it, until it is out of sight.
// track_mutex_ held.
void Odometry::Impl::TrackBackwards(std::span<const RetainedFrame> frames, const TrackingReference& reference) {
  SE3 guess, motion;
  AffineLight light = reference.light;
  for (std::size_t i = frames.size(); i-- > 0;) {
    const std::shared_ptr<FrameData> data = NewFrameData(frames[i].frame);
    recent_.light = light;
    TrackingOutcome outcome;
    if (!AlignBest(reference, *data, {motion * guess, guess}, 0.0, recent_.rms_gray, &outcome)) break;
    motion = outcome.new_from_reference * guess.Inverse();
    guess = outcome.new_from_reference;
    light = outcome.light;
    recent_.rms_gray = outcome.rms_gray;
    StoreRetracked(frames[i].position, reference.keyframe, guess.Inverse(), Quality(outcome));
  }
  recent_.rms_gray = 0.0;
}

}  // namespace cairn::direct

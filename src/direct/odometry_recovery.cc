// Going on from a view that somebody else knows: a lost odometry begins a new segment in a frame whose points have
// known depths, without waiting for parallax. The frames that were lost around it are tracked afterwards.
#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/status.h"
#include "direct/odometry_impl.h"

namespace cairn::direct {

namespace {

absl::Status CheckView(const KnownView& view) {
  for (const PacketPoint& point : view.points) {
    if (!(point.inverse_depth > 0.0f) || !std::isfinite(point.inverse_depth)) {
      return absl::InvalidArgumentError("a known view needs points with positive, finite inverse depths");
    }
  }
  if (view.points.size() < FirstWindow::kMinKnownPoints) {
    return absl::InvalidArgumentError(absl::StrCat("a known view needs at least ", FirstWindow::kMinKnownPoints,
                                                   " points, it has ", view.points.size()));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status Odometry::Impl::GoOnFrom(KnownView view) {
  CAIRN_RETURN_IF_ERROR(CheckView(view));
  std::lock_guard lock(mutex_);
  if (finished_) return absl::FailedPreconditionError("the odometry is finished");
  Job job;
  job.known = std::make_shared<const KnownView>(std::move(view));
  jobs_.push_back(std::move(job));
  return absl::OkStatus();
}

absl::StatusOr<FrameResult> Odometry::Impl::BeginFrom(const Frame& frame, const KnownView& view) {
  CAIRN_RETURN_IF_ERROR(CheckFrame(frame));
  CAIRN_RETURN_IF_ERROR(CheckView(view));
  const std::lock_guard track_lock(track_mutex_);
  FlushWindow();
  retained_.ClearLost();
  FrameResult result;
  result.index = frame.index;
  result.time_ns = frame.time_ns;
  RetainedFrame here{frame, 0};
  {
    std::lock_guard lock(mutex_);
    here.position = poses_.AddFrame(result);
    jobs_.clear();
    untracked_jobs_ = 0;
    mode_ = Mode::kStarting;
  }
  const SegmentNumbers numbers = NextNumbers();
  if (!first_window_.FromKnownView(frame, view, numbers)) {
    return absl::InvalidArgumentError("too few points of the known view are inside the image");
  }
  BeginSegmentAt(here, {}, numbers);
  return Result(here.position);
}

// The frames without a pose since the last tracked one, oldest first: kept already, or still queued. Empty if a
// frame has been tracked meanwhile. track_mutex_ held.
std::vector<RetainedFrame> Odometry::Impl::WaitingFrames() const {
  std::lock_guard lock(mutex_);
  if (mode_ == Mode::kTracking && recent_.lost_frames == 0) return {};
  std::vector<RetainedFrame> waiting;
  for (const RetainedFrame& retained : retained_.Waiting()) {
    if (poses_.frame(retained.position).keyframe < 0) waiting.push_back(retained);
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
    BeginSegmentAt(*here, {waiting.begin(), here}, numbers);
    retained_.SetLost(here + 1, waiting.end());
    std::lock_guard lock(mutex_);
    jobs_.clear();
    untracked_jobs_ = 1;
  }
  RequeueLost();
}

// The window has its first keyframe, of a known view. The frames before it, newest last, get poses, too. track_mutex_
// held.
void Odometry::Impl::BeginSegmentAt(const RetainedFrame& here, std::span<const RetainedFrame> before,
                                    const SegmentNumbers& numbers) {
  {
    std::lock_guard lock(mutex_);
    poses_.AddKeyframe({numbers.keyframe, numbers.segment, here.frame.index, here.frame.time_ns, SE3(), true});
  }
  const std::shared_ptr<const TrackingReference> reference = BuildReference(0);
  SetReference(reference);
  StoreRetracked(here.position, reference->keyframe, SE3(), 1.0);
  recent_.BeginSegment();
  TrackBackwards(before, *reference, nullptr);
  recent_.light = reference->light;
  std::lock_guard lock(mutex_);
  if (!before.empty()) poses_.Interpolate(before.front().position, here.position);
  mode_ = Mode::kTracking;
  keyframe_queued_ = false;
  keyframe_awaited_ = false;
  start_message_.clear();
  ++statistics_.segments;
  ++statistics_.recoveries;
  // Whoever knows the view can say at once where the segment is.
  packets_.push_back(MakePacket(window_.keyframe(0), true));
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

// Frames before the first keyframe of a segment, newest last: backwards against it, until it is out of sight, or the
// witness does not bear out a pose. A view that is known to others, whose depths are proven, needs none. track_mutex_
// held.
void Odometry::Impl::TrackBackwards(std::span<const RetainedFrame> frames, const TrackingReference& reference,
                                    CornerWitness* witness) {
  SE3 guess, motion;
  AffineLight light = reference.light;
  for (std::size_t i = frames.size(); i-- > 0;) {
    const std::shared_ptr<FrameData> data = NewFrameData(frames[i].frame);
    recent_.light = light;
    TrackingOutcome outcome;
    if (!AlignBest(reference, *data, {motion * guess, guess}, 0.0, recent_.rms_gray, &outcome)) break;
    if (witness != nullptr && !witness->BearsOut(frames[i].frame, outcome.new_from_reference)) break;
    motion = outcome.new_from_reference * guess.Inverse();
    guess = outcome.new_from_reference;
    light = outcome.light;
    recent_.rms_gray = outcome.rms_gray;
    StoreRetracked(frames[i].position, reference.keyframe, guess.Inverse(), Quality(outcome));
  }
  recent_.rms_gray = 0.0;
}

}  // namespace cairn::direct

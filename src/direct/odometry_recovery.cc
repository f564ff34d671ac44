// Going on from a view that somebody else knows: a lost odometry begins a new segment in a frame whose points have
// known depths, without waiting for parallax. The frames that were lost around it are tracked afterwards.
#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "direct/odometry_impl.h"

namespace cairn::direct {
namespace {

constexpr std::size_t kMinKnownPoints = 40;
constexpr double kKnownDepthSigma = 0.01;  // of a known point, relative
constexpr double kViewBorderPx = 4.0;

double MedianInverseDepth(const std::vector<PacketPoint>& points) {
  std::vector<float> inverse;
  for (const PacketPoint& point : points) inverse.push_back(point.inverse_depth);
  const auto middle = inverse.begin() + static_cast<std::ptrdiff_t>(inverse.size() / 2);
  std::nth_element(inverse.begin(), middle, inverse.end());
  return *middle;
}

}  // namespace

absl::Status Odometry::Impl::GoOnFrom(KnownView view) {
  for (const PacketPoint& point : view.points) {
    if (!(point.inverse_depth > 0.0f) || !std::isfinite(point.inverse_depth)) {
      return absl::InvalidArgumentError("a known view needs points with positive, finite inverse depths");
    }
  }
  if (view.points.size() < kMinKnownPoints) {
    return absl::InvalidArgumentError(
        absl::StrCat("a known view needs at least ", kMinKnownPoints, " points, it has ", view.points.size()));
  }
  std::lock_guard lock(mutex_);
  if (finished_) return absl::FailedPreconditionError("the odometry is finished");
  Job job;
  job.known = std::make_shared<const KnownView>(std::move(view));
  jobs_.push_back(std::move(job));
  return absl::OkStatus();
}

// The frames without a pose since the last tracked one, oldest first: kept already, or still to be mapped. Empty if a
// frame has been tracked meanwhile. track_mutex_ held.
std::vector<Odometry::Impl::Retained> Odometry::Impl::WaitingFrames() const {
  std::lock_guard lock(mutex_);
  if (mode_ == Mode::kTracking && lost_frames_ == 0) return {};
  std::vector<Retained> waiting;
  // While it starts anew, the lost frames are among the retained ones, or queued again.
  const std::deque<Retained>& kept = lost_.empty() ? retained_ : lost_;
  for (const Retained& retained : kept) {
    if (results_[retained.position].keyframe < 0) waiting.push_back(retained);
  }
  for (const Job& job : jobs_) {
    if (job.data) return {};
    if (!job.known) waiting.push_back({job.frame, job.position});
  }
  return waiting;
}

void Odometry::Impl::BeginAt(const KnownView& view) {
  const std::lock_guard track_lock(track_mutex_);
  const std::vector<Retained> waiting = WaitingFrames();
  const auto here = std::find_if(waiting.begin(), waiting.end(),
                                 [&](const Retained& retained) { return retained.frame.index == view.frame_index; });
  if (here == waiting.end()) return;
  FlushWindow();
  lost_.clear();
  if (!BuildKnownWindow(here->frame, view)) {
    window_.Clear();
    lost_.assign(waiting.begin(), waiting.end());  // for a start by motion
    std::lock_guard lock(mutex_);
    jobs_.clear();
    untracked_jobs_ = 1;
    mode_ = Mode::kStarting;
  } else {
    const std::shared_ptr<const TrackingReference> reference = BuildReference(0);
    SetReference(reference);
    StoreRetracked(here->position, reference->keyframe, SE3(), 1.0);
    ResetTracking();
    TrackBackwards(std::vector<Retained>(waiting.begin(), here), *reference);
    InterpolateThinned(waiting.front().position, here->position);
    last_light_ = reference->light;
    lost_.assign(here + 1, waiting.end());
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

// The first keyframe of a segment, with the known points; in units of their median depth.
bool Odometry::Impl::BuildKnownWindow(const Frame& frame, const KnownView& view) {
  auto keyframe = std::make_unique<Keyframe>();
  {
    std::lock_guard lock(mutex_);
    keyframe->id = static_cast<std::int64_t>(keyframes_.size());
  }
  keyframe->segment = segment_;
  keyframe->data = NewFrameData(frame);
  keyframe->own_prior[6] = 1e10, keyframe->own_prior[7] = 1e6;  // the brightness is relative to this one
  SelectCandidates(keyframe.get());
  const ImagePyramid& pyramid = keyframe->data->pyramid;
  const Pinhole& camera = geometry_.camera[0];
  const std::int64_t id = keyframe->id;
  window_.AddKeyframe(std::move(keyframe));
  const double unit = MedianInverseDepth(view.points);
  const double scale = geometry_.half ? 0.5 : 1.0, offset = geometry_.half ? -0.25 : 0.0;
  ImmaturePoint pattern;
  for (const PacketPoint& known : view.points) {
    const int x = static_cast<int>(std::lround(scale * known.x_px + offset));
    const int y = static_cast<int>(std::lround(scale * known.y_px + offset));
    if (!camera.Contains(Vector2d(x, y), kViewBorderPx)) continue;
    if (!MakeImmaturePoint(pyramid, x, y, options_.gradient_constant_gray, options_.outlier_gray, &pattern)) continue;
    ActivePoint point;
    point.x = pattern.x, point.y = pattern.y, point.host = 0;
    std::copy(pattern.color, pattern.color + kPatternSize, point.color);
    std::copy(pattern.weight, pattern.weight + kPatternSize, point.weight);
    point.inverse_depth = static_cast<float>(known.inverse_depth / unit);
    const double sigma = kKnownDepthSigma * point.inverse_depth;
    point.hessian = static_cast<float>(1.0 / (sigma * sigma));
    point.good_residuals = 1;
    window_.AddPoint(point);
    ++window_.newest().points_made;
  }
  if (window_.points().size() < kMinKnownPoints) return false;
  spacing_px_ = 4.0;
  std::lock_guard lock(mutex_);
  keyframes_.push_back({id, segment_, frame.index, frame.time_ns, SE3(), true});
  return true;
}

// Frames before the first keyframe of a segment, newest last: backwards against it, until it is out of sight.
// track_mutex_ held.
void Odometry::Impl::TrackBackwards(std::span<const Retained> frames, const TrackingReference& reference) {
  SE3 guess, motion;
  AffineLight light = reference.light;
  for (std::size_t i = frames.size(); i-- > 0;) {
    const std::shared_ptr<FrameData> data = NewFrameData(frames[i].frame);
    last_light_ = light;
    TrackingOutcome outcome;
    if (!AlignBest(reference, *data, {motion * guess, guess}, 0.0, last_rms_, &outcome)) break;
    motion = outcome.new_from_reference * guess.Inverse();
    guess = outcome.new_from_reference;
    light = outcome.light;
    last_rms_ = outcome.rms_gray;
    StoreRetracked(frames[i].position, reference.keyframe, guess.Inverse(), Quality(outcome));
  }
  last_rms_ = 0.0;
}

}  // namespace cairn::direct

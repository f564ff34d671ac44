// What the odometry makes of a start (direct/odometry_start.h): poses for the frames that waited for it, and all of
// that undone again where the start was wrong (direct/start_confirmation.h).
#include <malloc.h>

#include <algorithm>

#include "direct/odometry_impl.h"

namespace cairn::direct {
namespace {

// That are held back while a start is doubted; each holds its image. Then it is trusted.
constexpr std::size_t kMaxHeldPackets = 60;
// So many starts in a row must contradict one that nothing proved: someone who passes through the view does so once,
// until he is known as an obstacle; a wrong start contradicts everything.
constexpr int kContradictions = 2;

}  // namespace

SegmentNumbers Odometry::Impl::NextNumbers() const {
  std::lock_guard lock(mutex_);
  return {segment_, poses_.next_keyframe()};
}

void Odometry::Impl::AddToStart(const Job& job) {
  StartResult start;
  {
    const Timer timer(this, &statistics_.start);
    start = start_.Add(job.frame, job.position, NextNumbers());
  }
  if (!start.success) {
    std::lock_guard lock(mutex_);
    start_message_ = start.message;
    poses_.frame(job.position).message = start.message;
    return;
  }
  const std::lock_guard track_lock(track_mutex_);
  AdoptStart(start);
}

// The first window stands: poses for the frames that waited. track_mutex_ held.
void Odometry::Impl::AdoptStart(const StartResult& start) {
  AddFirstKeyframes();
  recent_.BeginSegment();
  RetrackRetained(start);
  {
    std::lock_guard lock(mutex_);
    poses_.Interpolate(retained_.start().front().position, retained_.SinceReference(0).position);
  }
  recent_.light = window_.newest().light;
  confirmation_.Begin();
  std::lock_guard lock(mutex_);
  mode_ = Mode::kTracking;
  start_doubted_ = true;
  // The start needed many pyramids at once, tracking needs few.
  pool_.Trim();
  start_message_.clear();
  ++statistics_.segments;
}

// All that are in the window.
void Odometry::Impl::AddFirstKeyframes() {
  std::lock_guard lock(mutex_);
  for (int k = 0; k < window_.size(); ++k) {
    const Keyframe& keyframe = window_.keyframe(k);
    const Frame& frame = keyframe.data->frame;
    KeyframePose pose = {keyframe.id, segment_, frame.index, frame.time_ns, keyframe.camera_from_direct.Inverse(),
                         true};
    if (k > 0) {  // what the frames between are retracked by
      pose.reference = window_.keyframe(k - 1).id;
      pose.reference_from_camera = window_.keyframe(k - 1).camera_from_direct * keyframe.camera_from_direct.Inverse();
    }
    poses_.AddKeyframe(pose);
  }
}

void Odometry::Impl::StoreRetracked(std::size_t position, std::int64_t keyframe, const SE3& keyframe_from_camera,
                                    double quality) {
  std::lock_guard lock(mutex_);
  poses_.SetPose(position, keyframe, keyframe_from_camera, quality);
}

// Between the keyframes: from the adjusted pose, against the nearest keyframe. Before the reference: backwards.
// track_mutex_ held.
void Odometry::Impl::RetrackRetained(const StartResult& start) {
  {
    std::lock_guard lock(mutex_);
    references_.clear();
  }
  const std::deque<RetainedFrame>& retained = retained_.start();
  std::vector<std::shared_ptr<const TrackingReference>> references;
  std::vector<std::size_t> at;  // of the keyframes, in retained
  for (int k = 0; k < window_.size(); ++k) {
    references.push_back(BuildReference(k));
    for (std::size_t i = 0; i < retained.size(); ++i) {
      if (retained[i].frame.index == window_.keyframe(k).data->frame.index) at.push_back(i);
    }
    SetReference(references.back());
    StoreRetracked(retained[at.back()].position, window_.keyframe(k).id, SE3(), 1.0);
  }
  const std::size_t reference_at = retained_.reference();
  const auto adjusted = [&](std::size_t i) { return start.camera_from_reference[i - reference_at]; };
  for (std::size_t i = reference_at; i < retained.size(); ++i) {
    if (std::find(at.begin(), at.end(), i) != at.end()) continue;
    std::size_t nearest = 0;
    for (std::size_t k = 1; k < at.size(); ++k) {
      const auto distance = [&](std::size_t other) { return i > at[other] ? i - at[other] : at[other] - i; };
      if (distance(k) < distance(nearest)) nearest = k;
    }
    const SE3 guess = adjusted(i) * adjusted(at[nearest]).Inverse();
    double quality;
    SE3 pose = RetrackOne(retained[i].frame, *references[nearest], guess, &quality);
    // All hang on the keyframe before them, so that they follow both (direct/frame_spread.h).
    std::size_t before = nearest;
    if (at[nearest] > i && nearest > 0) {
      before = nearest - 1;
      pose = window_.keyframe(static_cast<int>(before)).camera_from_direct *
             window_.keyframe(static_cast<int>(nearest)).camera_from_direct.Inverse() * pose;
    }
    StoreRetracked(retained[i].position, references[before]->keyframe, pose, quality);
  }
  const std::vector<RetainedFrame> before(retained.begin(),
                                          retained.begin() + static_cast<std::ptrdiff_t>(reference_at));
  if (before.empty()) return;
  CornerWitness witness(options_, camera_, retained[reference_at].frame, start.rms_px);
  TrackBackwards(before, *references.front(), &witness);
}

// The pose in the reference by the image, or by the guess where that is not believed. track_mutex_ held.
SE3 Odometry::Impl::RetrackOne(const Frame& frame, const TrackingReference& reference, const SE3& guess,
                               double* quality) {
  const double never[kMaxLevels] = {};
  double rms[kMaxLevels] = {};
  const std::shared_ptr<FrameData> data = NewFrameData(frame);
  const TrackingOutcome outcome =
      tracker_.Align(reference, *data, {guess}, reference.light,
                     PriorOf(data->frame, options_.affine_a_sigma, options_.affine_b_sigma_gray), never, rms);
  const bool good = Plausible(reference, *data, outcome);
  *quality = good ? Quality(outcome) : kInterpolatedQuality;
  return (good ? outcome.new_from_reference : guess).Inverse();
}

// One more frame after the start, tracked or lost.
void Odometry::Impl::DoubtStart(const Frame& frame, std::size_t position, bool tracked) {
  if (!start_doubted_) return;
  const Timer timer(this, &statistics_.start);
  retained_.Add(frame, position);
  if (looks_again_) return DoubtAgain();
  StartResult better;
  switch (confirmation_.Judge(frame, tracked, PosesSinceReference(), &better)) {
    case StartVerdict::kOpen:
      return;
    case StartVerdict::kRight:
      return TrustStart();
    case StartVerdict::kUnproven:
      contradictions_ = 0;
      return LookAgain();
    case StartVerdict::kWrong:
      UndoStart(better);
      if (start_doubted_) TrustStart();
      return;
  }
}

// The start stands and remains in doubt, with new corners.
void Odometry::Impl::LookAgain() {
  looks_again_ = true;
  start_.LookAgain();
}

// Corners on an obstacle tell its motion, not the camera's.
void Odometry::Impl::DoubtAgain() {
  {
    std::lock_guard lock(mutex_);
    if (packets_.size() > kMaxHeldPackets) looks_again_ = false;
  }
  if (!looks_again_) return TrustStart();
  if (cover_.mask.any()) {
    contradictions_ = 0;
    return LookAgain();
  }
  const StartResult second = start_.FollowAgain();
  if (!second.success) return;
  const StartVerdict verdict = confirmation_.Compare(second, PosesSinceReference());
  if (verdict == StartVerdict::kUnproven) return LookAgain();
  if (verdict == StartVerdict::kWrong && ++contradictions_ < kContradictions) return LookAgain();
  looks_again_ = false;
  // Either way it is to be proven as the first one was to be.
  if (verdict == StartVerdict::kWrong) return UndoStart(second);
  confirmation_.Begin();
}

std::vector<std::optional<SE3>> Odometry::Impl::PosesSinceReference() const {
  std::vector<std::optional<SE3>> poses;
  poses.reserve(retained_.start().size() - retained_.reference());
  std::lock_guard lock(mutex_);
  for (std::size_t i = retained_.reference(); i < retained_.start().size(); ++i) {
    const FrameResult& result = poses_.frame(retained_.start()[i].position);
    poses.push_back(result.keyframe < 0 ? std::nullopt : std::optional<SE3>(poses_.DirectFromCamera(result)));
  }
  return poses;
}

void Odometry::Impl::UndoStart(const StartResult& better) {
  const std::lock_guard track_lock(track_mutex_);
  {
    std::lock_guard lock(mutex_);
    poses_.Forget(segment_, retained_.start().front().position);
    std::erase_if(packets_, [&](const KeyframePacket& packet) { return packet.segment == segment_; });
    references_.clear();
    start_message_ = "the start was found wrong and is undone";
    for (Job& job : jobs_) {                 // tracked against what is gone
      if (!job.data && !job.lost) continue;  // as it is: untracked, or a known view
      if (!job.restart) ++untracked_jobs_;   // else counted already
      Job again;
      again.frame = job.data ? job.data->frame : job.frame;
      again.position = job.position;
      job = std::move(again);
    }
    keyframe_queued_ = false;
    start_doubted_ = false;
    mode_ = Mode::kStarting;
    --statistics_.segments;
    ++statistics_.starts_undone;
  }
  retained_.ClearLost();
  last_frame_ = {};
  cover_.Reset();
  window_.Clear();
  if (start_.Redo(better, NextNumbers())) AdoptStart(better);
}

void Odometry::Impl::TrustStart() {
  start_.Reset();
#ifdef __GLIBC__
  malloc_trim(0);  // the frames that waited leave holes too small for pyramids: back to the system
#endif
  std::lock_guard lock(mutex_);
  start_doubted_ = false;
}

}  // namespace cairn::direct

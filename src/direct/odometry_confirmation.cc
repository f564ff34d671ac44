// A start is doubted until the camera has moved on by about as much again: the corners of the start are followed all
// the while, and two-view geometry and bundle adjustment over the longer way must not explain them much better than the
// odometry's poses do. A start found wrong is undone: the new answer builds another first window, and all frames, which
// were kept, are tracked again. Packets are held back meanwhile.
#include <malloc.h>

#include <algorithm>
#include <optional>

#include "direct/odometry_impl.h"

namespace cairn::direct {
namespace {

constexpr int kMinDoubtedFrames = 5;  // after the start
constexpr int kMaxDoubtedFrames = 30;
constexpr double kWayRatio = 2.0;  // against the way of the start: then it is judged
constexpr double kWrongCostRatio = 2.0;
constexpr double kWrongCostPx2 = 0.3;  // and by how much more, at least

}  // namespace

// One more frame after the start, tracked or lost.
void Odometry::Impl::DoubtStart(const Frame& frame, std::size_t position, bool tracked) {
  if (!start_doubted_) return;
  const Timer timer(this, &statistics_.start);
  retained_.push_back({frame, position});
  const bool followed = start_.Continue(frame);
  const int after = start_.FrameCount() - start_frames_;
  if (!tracked && followed && after < kMaxDoubtedFrames) return;
  bool judge = !followed || after >= kMaxDoubtedFrames;
  if (!judge && after >= kMinDoubtedFrames) {
    std::lock_guard lock(mutex_);
    const auto centre = [&](std::size_t at) {
      return DirectFromCamera(results_[retained_[at].position]).translation();
    };
    const std::size_t first = start_reference_, last = first + static_cast<std::size_t>(start_frames_) - 1;
    judge = (centre(retained_.size() - 1) - centre(first)).norm() > kWayRatio * (centre(last) - centre(first)).norm();
  }
  if (!judge) return;
  StartResult better;
  if (tracked && StartIsWrong(&better)) {
    UndoStart(better);
  } else {
    TrustStart();
  }
}

bool Odometry::Impl::StartIsWrong(StartResult* better) {
  *better = start_.SolveAgain();
  if (!better->success) return false;  // nothing better is known
  std::vector<std::optional<SE3>> poses;
  {
    std::lock_guard lock(mutex_);
    const SE3 camera_from_direct = DirectFromCamera(results_[retained_[start_reference_].position]).Inverse();
    for (std::size_t i = start_reference_; i < retained_.size(); ++i) {
      const FrameResult& result = results_[retained_[i].position];
      poses.push_back(result.keyframe < 0
                          ? std::nullopt
                          : std::optional<SE3>((camera_from_direct * DirectFromCamera(result)).Inverse()));
    }
  }
  const double cost = start_.CostOf(poses);
  return cost < 1e299 && cost > kWrongCostRatio * better->cost && cost > better->cost + kWrongCostPx2;
}

void Odometry::Impl::UndoStart(const StartResult& better) {
  const std::lock_guard track_lock(track_mutex_);
  {
    std::lock_guard lock(mutex_);
    std::erase_if(keyframes_, [&](const KeyframePose& keyframe) { return keyframe.segment == segment_; });
    std::erase_if(packets_, [&](const KeyframePacket& packet) { return packet.segment == segment_; });
    references_.clear();
    start_message_ = "the start was found wrong and is undone";
    for (std::size_t i = retained_.front().position; i < results_.size(); ++i) {
      FrameResult fresh;
      fresh.index = results_[i].index;
      fresh.time_ns = results_[i].time_ns;
      results_[i] = fresh;
    }
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
  lost_.clear();
  last_frame_ = {};
  cover_.Reset();
  clear_reference_ = nullptr;
  window_.Clear();
  std::string message;
  if (BuildFirstWindow(better, start_reference_, &message)) {
    AdoptStart(better);
    TrustStart();
    return;
  }
  const Frame newest = retained_.back().frame;
  window_.Clear();
  start_.Reset();
  start_.Add(newest);
  start_reference_ = retained_.size() - 1;
  while (start_reference_ > static_cast<std::size_t>(options_.max_retained_frames)) ThinRetained();
}

void Odometry::Impl::TrustStart() {
  retained_.clear();
  start_reference_ = 0;
  start_.Reset();
#ifdef __GLIBC__
  malloc_trim(0);  // the frames that waited leave holes too small for pyramids: back to the system
#endif
  std::lock_guard lock(mutex_);
  start_doubted_ = false;
}

}  // namespace cairn::direct

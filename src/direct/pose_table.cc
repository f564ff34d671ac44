#include "direct/pose_table.h"

#include <algorithm>

#include "geometry/pose_spread.h"

namespace cairn::direct {

std::size_t PoseTable::AddFrame(const FrameResult& frame) {
  frames_.push_back(frame);
  return end_position() - 1;
}

SE3 PoseTable::DirectFromCamera(const FrameResult& frame) const {
  if (frame.keyframe < 0) return frame.direct_from_camera;
  return keyframe(frame.keyframe).direct_from_camera * frame.keyframe_from_camera;
}

FrameResult PoseTable::Composed(std::size_t position) const {
  FrameResult frame = this->frame(position);
  frame.direct_from_camera = DirectFromCamera(frame);
  if (frame.keyframe >= 0) frame.segment = keyframe(frame.keyframe).segment;
  return frame;
}

PoseTable::TrackedPair PoseTable::LastTracked(std::int64_t segment) const {
  TrackedPair pair;
  for (auto it = frames_.rbegin(); it != frames_.rend() && pair.before == nullptr; ++it) {
    if (it->keyframe < 0) {
      if (pair.last != nullptr) break;
      continue;
    }
    if (keyframe(it->keyframe).segment != segment) break;
    (pair.last == nullptr ? pair.last : pair.before) = &*it;
  }
  return pair;
}

std::int64_t PoseTable::CountTracked() const {
  return forgotten_tracked_ +
         std::count_if(frames_.begin(), frames_.end(), [](const FrameResult& frame) { return frame.keyframe >= 0; });
}

double PoseTable::KeyframeRateHz() const {
  const std::size_t n = keyframes_.size();
  std::size_t first = n > 10 ? n - 10 : 0;
  while (first < n && keyframes_[first].segment != keyframes_.back().segment) ++first;
  if (n < first + 2) return 0.0;
  const double seconds = ToSeconds(keyframes_.back().time_ns - keyframes_[first].time_ns);
  return seconds > 0.0 ? static_cast<double>(n - 1 - first) / seconds : 0.0;
}

void PoseTable::SetPose(std::size_t position, std::int64_t keyframe, const SE3& keyframe_from_camera, double quality) {
  FrameResult& frame = this->frame(position);
  frame.keyframe = keyframe;
  frame.keyframe_from_camera = keyframe_from_camera;
  frame.direct_from_camera = DirectFromCamera(frame);
  frame.quality = quality;
  frame.state = StateOf(quality);
  frame.message.clear();
}

void PoseTable::Interpolate(std::size_t first, std::size_t last) {
  std::size_t before = first;
  for (std::size_t after = first; after <= last; ++after) {
    if (frame(after).keyframe < 0) continue;
    const FrameResult &from = frame(before), &to = frame(after);
    const double step_s = ToSeconds(to.time_ns - from.time_ns);
    for (std::size_t i = before + 1; from.keyframe >= 0 && step_s > 0.0 && i < after; ++i) {
      FrameResult& between = frame(i);
      const double share = ToSeconds(between.time_ns - from.time_ns) / step_s;
      const SE3 pose = Between(DirectFromCamera(from), DirectFromCamera(to), share);
      between.keyframe = to.keyframe;
      between.keyframe_from_camera = keyframe(to.keyframe).direct_from_camera.Inverse() * pose;
      between.direct_from_camera = pose;
      between.quality = kInterpolatedQuality;
      between.state = StateOf(kInterpolatedQuality);
      between.message = "between its neighbours: its image was dropped during a long wait for the start";
    }
    before = after;
  }
}

void PoseTable::Forget(std::int64_t segment, std::size_t first) {
  std::erase_if(keyframes_, [&](const KeyframePose& keyframe) { return keyframe.segment == segment; });
  for (std::size_t i = first; i < end_position(); ++i) {
    FrameResult fresh;
    fresh.index = frame(i).index;
    fresh.time_ns = frame(i).time_ns;
    frame(i) = fresh;
  }
}

void PoseTable::ForgetOld() {
  if (frames_.size() < 2 * kKept) return;
  const auto kept = frames_.end() - static_cast<std::ptrdiff_t>(kKept);
  const auto tracked = [](const FrameResult& frame) { return frame.keyframe >= 0; };
  forgotten_tracked_ += std::count_if(frames_.begin(), kept, tracked);
  first_position_ += static_cast<std::size_t>(kept - frames_.begin());
  frames_.erase(frames_.begin(), kept);
  std::int64_t needed = next_keyframe() - static_cast<std::int64_t>(kKept);
  for (const FrameResult& frame : frames_) {
    if (tracked(frame)) needed = std::min(needed, frame.keyframe);
  }
  auto first = keyframes_.begin();
  while (first != keyframes_.end() && first->keyframe < needed && !first->still_active) ++first;
  first_keyframe_ += first - keyframes_.begin();
  keyframes_.erase(keyframes_.begin(), first);
}

}  // namespace cairn::direct

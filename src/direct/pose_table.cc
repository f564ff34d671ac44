#include "direct/pose_table.h"

#include <algorithm>

#include "geometry/pose_spread.h"

namespace cairn::direct {

std::size_t PoseTable::AddFrame(const FrameResult& frame) {
  frames_.push_back(frame);
  return frames_.size() - 1;
}

SE3 PoseTable::DirectFromCamera(const FrameResult& frame) const {
  if (frame.keyframe < 0) return frame.direct_from_camera;
  return keyframe(frame.keyframe).direct_from_camera * frame.keyframe_from_camera;
}

FrameResult PoseTable::Composed(std::size_t position) const {
  FrameResult frame = frames_[position];
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
  return std::count_if(frames_.begin(), frames_.end(), [](const FrameResult& frame) { return frame.keyframe >= 0; });
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
  FrameResult& frame = frames_[position];
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
    if (frames_[after].keyframe < 0) continue;
    const FrameResult &from = frames_[before], &to = frames_[after];
    const double step_s = ToSeconds(to.time_ns - from.time_ns);
    for (std::size_t i = before + 1; from.keyframe >= 0 && step_s > 0.0 && i < after; ++i) {
      FrameResult& frame = frames_[i];
      const double share = ToSeconds(frame.time_ns - from.time_ns) / step_s;
      const SE3 pose = Between(DirectFromCamera(from), DirectFromCamera(to), share);
      frame.keyframe = to.keyframe;
      frame.keyframe_from_camera = keyframe(to.keyframe).direct_from_camera.Inverse() * pose;
      frame.direct_from_camera = pose;
      frame.quality = kInterpolatedQuality;
      frame.state = StateOf(kInterpolatedQuality);
      frame.message = "between its neighbours: its image was dropped during a long wait for the start";
    }
    before = after;
  }
}

void PoseTable::Forget(std::int64_t segment, std::size_t first) {
  std::erase_if(keyframes_, [&](const KeyframePose& keyframe) { return keyframe.segment == segment; });
  for (std::size_t i = first; i < frames_.size(); ++i) {
    FrameResult fresh;
    fresh.index = frames_[i].index;
    fresh.time_ns = frames_[i].time_ns;
    frames_[i] = fresh;
  }
}

}  // namespace cairn::direct

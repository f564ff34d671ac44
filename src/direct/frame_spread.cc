#include "direct/frame_spread.h"

#include <optional>

#include "geometry/pose_spread.h"

namespace cairn::direct {
namespace {

// The motion from a keyframe to the next as tracking saw it: both against the same keyframe, or the next against this.
std::optional<SE3> TrackedMotion(const KeyframePose& from, const KeyframePose& to) {
  if (to.reference < 0) return std::nullopt;
  if (to.reference == from.keyframe) return to.reference_from_camera;
  if (to.reference == from.reference) return from.reference_from_camera.Inverse() * to.reference_from_camera;
  return std::nullopt;
}

}  // namespace

void SpreadCorrection(const std::vector<KeyframePose>& keyframes, FrameResult* frame) {
  if (frame->keyframe < 0) return;
  for (auto next = static_cast<std::size_t>(frame->keyframe + 1); next < keyframes.size(); ++next) {
    const KeyframePose &before = keyframes[next - 1], &after = keyframes[next];
    if (frame->time_ns <= before.time_ns) return;
    const std::optional<SE3> tracked = TrackedMotion(before, after);
    if (!tracked) return;
    if (frame->time_ns < after.time_ns) {
      const double share =
          static_cast<double>(frame->time_ns - before.time_ns) / static_cast<double>(after.time_ns - before.time_ns);
      const SE3 optimized = before.direct_from_camera.Inverse() * after.direct_from_camera;
      frame->keyframe_from_camera = SpreadDifference(frame->keyframe_from_camera, *tracked, optimized, share);
      return;
    }
    frame->keyframe = after.keyframe;
    frame->keyframe_from_camera = tracked->Inverse() * frame->keyframe_from_camera;
  }
}

}  // namespace cairn::direct

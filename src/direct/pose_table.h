// The poses of all frames and keyframes of a run, in frame "direct" (its unit: the median depth of the segment's first
// keyframe). That of a frame is kept against a keyframe's, so that it follows what optimization makes of the keyframe.
//
// Read by whoever asks for poses while frames are tracked and keyframes optimized, and without a lock of its own: the
// odometry holds Odometry::Impl::mutex_ for every call.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "direct/odometry.h"

namespace cairn::direct {

inline constexpr double kInterpolatedQuality = 0.3;  // of a pose that no image says
inline constexpr double kPoorQuality = 0.6;          // below

inline TrackingState StateOf(double quality) {
  return quality >= kPoorQuality ? TrackingState::kGood : TrackingState::kPoor;
}

class PoseTable {
 public:
  // Frames by their position: the order in which they came. Keyframes by their number.
  const std::vector<FrameResult>& frames() const { return frames_; }
  FrameResult& frame(std::size_t position) { return frames_[position]; }
  const std::vector<KeyframePose>& keyframes() const { return keyframes_; }
  KeyframePose& keyframe(std::int64_t id) { return keyframes_[static_cast<std::size_t>(id)]; }
  const KeyframePose& keyframe(std::int64_t id) const { return keyframes_[static_cast<std::size_t>(id)]; }
  std::int64_t next_keyframe() const { return static_cast<std::int64_t>(keyframes_.size()); }

  // Returns its position.
  std::size_t AddFrame(const FrameResult& frame);
  void AddKeyframe(const KeyframePose& keyframe) { keyframes_.push_back(keyframe); }

  // By the keyframe's newest pose; what was stored, for a frame without one.
  SE3 DirectFromCamera(const FrameResult& frame) const;
  // A frame with that pose, and the segment it is in.
  FrameResult Composed(std::size_t position) const;
  // The newest two frames with a pose in a segment, in the order of time; null where there is none.
  struct TrackedPair {
    const FrameResult* before = nullptr;
    const FrameResult* last = nullptr;
  };
  TrackedPair LastTracked(std::int64_t segment) const;
  std::int64_t CountTracked() const;
  // Over the last ten keyframes of the newest segment; 0 for a single one.
  double KeyframeRateHz() const;

  // What was found out of a frame later than when it came.
  void SetPose(std::size_t position, std::int64_t keyframe, const SE3& keyframe_from_camera, double quality);
  // Frames without a pose get one between their neighbours', at constant velocity: for those whose images were dropped.
  // Both positions count.
  void Interpolate(std::size_t first, std::size_t last);
  // The keyframes of the newest segment, and all that is known of the frames from a position on.
  void Forget(std::int64_t segment, std::size_t first);

 private:
  std::vector<FrameResult> frames_;
  std::vector<KeyframePose> keyframes_;
};

}  // namespace cairn::direct

// The poses of all frames and keyframes of a run, in frame "direct" (its unit: the median depth of the segment's first
// keyframe). That of a frame is kept against a keyframe's, so that it follows what optimization makes of the keyframe.
//
// Read by whoever asks for poses while frames are tracked and keyframes optimized, and without a lock of its own: the
// odometry holds Odometry::Impl::mutex_ for every call.
//
// It grows with the run, unless ForgetOld() is called: then it holds the newest frames and what they refer to.
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
  // Frames by their position: the order in which they came. Keyframes by their number. Those that are kept.
  const std::vector<FrameResult>& frames() const { return frames_; }
  FrameResult& frame(std::size_t position) { return frames_[position - first_position_]; }
  const FrameResult& frame(std::size_t position) const { return frames_[position - first_position_]; }
  const std::vector<KeyframePose>& keyframes() const { return keyframes_; }
  KeyframePose& keyframe(std::int64_t id) { return keyframes_[static_cast<std::size_t>(id - first_keyframe_)]; }
  const KeyframePose& keyframe(std::int64_t id) const {
    return keyframes_[static_cast<std::size_t>(id - first_keyframe_)];
  }
  // One past the last; what was forgotten is counted.
  std::size_t end_position() const { return first_position_ + frames_.size(); }
  std::int64_t next_keyframe() const { return first_keyframe_ + static_cast<std::int64_t>(keyframes_.size()); }
  bool KnowsKeyframe(std::int64_t id) const { return id >= first_keyframe_ && id < next_keyframe(); }

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
  // Once there are twice kKept frames, all but the newest kKept, and the keyframes that no kept frame hangs on and that
  // are in no window any more. What waits for a pose is far newer (RetainedFrames). O(1) per frame.
  static constexpr std::size_t kKept = 2048;
  void ForgetOld();

 private:
  std::vector<FrameResult> frames_;
  std::vector<KeyframePose> keyframes_;
  std::size_t first_position_ = 0;      // of frames_
  std::int64_t first_keyframe_ = 0;     // of keyframes_
  std::int64_t forgotten_tracked_ = 0;  // frames with a pose
};

}  // namespace cairn::direct

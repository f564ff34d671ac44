// Photometric odometry with a sliding window of keyframes: a clean-room build of Engel, Koltun and Cremers, "Direct
// Sparse Odometry" (PAMI 2018), started by two-view geometry and a small bundle adjustment of corners instead of its
// photometric initializer. It gives the pose of every frame and a packet for every keyframe that leaves its window (Lee
// and Civera, "Loosely-Coupled Semi-Direct Monocular SLAM", RA-L 2019, Sec. III).
//
// Poses are in frame "direct": the first keyframe of a segment is its origin, the median depth there is 1.
//
// One thread: Process() for each frame. Two threads: Track() on one, OptimizeNext() on the other; the two calls may run
// at the same time, everything else is safe between calls of either. Same input through Process(): same output, to the
// bit.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "absl/status/statusor.h"
#include "base/sample_reservoir.h"
#include "base/time.h"
#include "direct/odometry_options.h"
#include "direct/packet.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"

namespace cairn::direct {

// Where the time went: a sample per call, in milliseconds.
struct StageTime {
  SampleReservoir samples_ms;
};

struct OdometryStatistics {
  StageTime pyramid;      // per frame
  StageTime track;        // per frame, pyramid included
  StageTime trace;        // per tracked frame
  StageTime activate;     // per keyframe
  StageTime optimize;     // per keyframe
  StageTime marginalize;  // per keyframe
  StageTime start;        // per frame while initializing
  std::int64_t frames = 0;
  std::int64_t frames_tracked = 0;  // with a pose, counting those tracked after the start
  std::int64_t keyframes = 0;
  std::int64_t segments = 0;       // starts that succeeded
  std::int64_t starts_undone = 0;  // found wrong by what followed, and replaced
  std::int64_t recoveries = 0;     // of the segments those that began at a known view
};

// A keyframe's best pose so far; final once it has left the window.
struct KeyframePose {
  std::int64_t keyframe = 0;
  std::int64_t segment = 0;
  std::int64_t frame_index = 0;
  TimeNs time_ns = 0;
  SE3 direct_from_camera;
  bool still_active = false;
  // What tracking (for the first keyframes: the start) made of it before its window was optimized: its pose against the
  // keyframe it was tracked against; -1 for the first of a segment.
  std::int64_t reference = -1;
  SE3 reference_from_camera = SE3();
};

// The poses of all frames and keyframes at one moment.
struct PoseHistory {
  std::vector<FrameResult> frames;      // as FrameResults() says
  std::vector<KeyframePose> keyframes;  // as KeyframeTrajectory() says
};

// After so long a time between two images nothing is known of the motion, and what is seen must prove itself like what
// ends a loss. Half a second of images may be missing, at 20 per second and more, or four at lower rates.
inline constexpr double kMaxBridgedS = 0.55;
inline constexpr double kMaxBridgedIntervals = 5.0;
inline bool IsLongGap(double gap_s, double interval_s) {
  return gap_s > kMaxBridgedS && gap_s > kMaxBridgedIntervals * interval_s;
}

class Odometry {
 public:
  // `camera` is that of Frame::image (full resolution, undistorted). InvalidArgument for bad options or a camera
  // without focal length or smaller than 64 x 48 px.
  static absl::StatusOr<std::unique_ptr<Odometry>> Create(const OdometryOptions& options, const Pinhole& camera);
  ~Odometry();
  Odometry(const Odometry&) = delete;
  Odometry& operator=(const Odometry&) = delete;

  // Track() and then OptimizeNext() until nothing is left. The result is the best known of this frame after that.
  // InvalidArgument (and nothing changes) for an image that is empty or not of the camera's size and type, or a frame
  // whose index is not larger than the last one's.
  absl::StatusOr<FrameResult> Process(const Frame& frame);

  // The live pose of one frame, and its hand-over to OptimizeNext(). While the odometry starts, or starts anew, the
  // state is kInitializing and `message` says what it waits for; such frames get their poses once the start succeeds.
  absl::StatusOr<FrameResult> Track(const Frame& frame);
  // Works the oldest frame handed over into the window: its image narrows the depths of candidate points, or it becomes
  // a keyframe and the window is optimized. While the odometry starts, it is one more frame for the start. False if
  // there was none.
  bool OptimizeNext();
  int PendingFrames() const;
  // The view is running out of known points, and the keyframe that brings new ones is not made yet: with two threads,
  // the next Track() should wait for OptimizeNext().
  bool AwaitsKeyframe() const;

  // Ends a loss: at one of the frames without a pose since the last tracked one, of which somebody knows the depths of
  // some points, a new segment begins, and the lost frames around it are tracked. Only queued here, for OptimizeNext();
  // without effect if a frame has been tracked meanwhile, or that frame is not kept any more. The caller's units have
  // no further use: as in any segment the median depth is 1. InvalidArgument for too few points, or bad depths.
  absl::Status GoOnFrom(KnownView view);

  // Begins, or begins anew, at a frame of which somebody knows the depths of some points: it has a pose when this
  // returns, in a segment of its own whose first keyframe it is, and its packet, which is there at once, says how long
  // the caller's unit is in it. The frame must not have been given to Track(), view.frame_index is not used, and frames
  // that wait for a pose are given up. Neither at the same time as Track() nor as OptimizeNext(). InvalidArgument as
  // Track() and GoOnFrom(), and where too few of the points are inside the image: then there is no pose, and the
  // odometry starts by motion.
  absl::StatusOr<FrameResult> BeginFrom(const Frame& frame, const KnownView& view);

  // a_from_b by the newest poses of the keyframes that the results refer to; nothing if one refers to none, or to one
  // that has been forgotten (OdometryOptions::keep_history), or they are of two segments. O(1): what others found out
  // about a frame can be carried on to later ones by it, whatever optimization has changed meanwhile.
  std::optional<SE3> Motion(const FrameResult& a, const FrameResult& b) const;

  // Packets of the keyframes that left the window since the last call, in the order of leaving, and at once (and still
  // active) the first keyframe of a segment that began at a known view. None while a start may
  // still be undone: then its keyframes, and the poses of its frames, are replaced (direct/start_confirmation.h).
  std::vector<KeyframePacket> TakePackets();
  // The packet of a keyframe that is still in the window; NotFound otherwise. Not at the same time as OptimizeNext().
  absl::StatusOr<KeyframePacket> PacketOf(std::int64_t keyframe) const;
  // Ends the run: the last tracked frame becomes a keyframe, and the keyframes still in the window become packets (with
  // still_active false). Only reading calls after it.
  void Finish();

  // One per accepted frame, in temporal order, with direct_from_camera recomputed from the keyframe's newest pose. What
  // optimization changed of the motion from a keyframe to the next is spread evenly over the time between (also in
  // keyframe_from_camera), so that the poses between are as good as the keyframes'.
  // keyframe is -1 and the state kInitializing or kLost for the frames without a pose.
  std::vector<FrameResult> FrameResults() const { return Poses().frames; }
  // Both, of one moment. Tracking and optimization go on meanwhile: they wait for copies of parts at most, not for the
  // sums.
  PoseHistory Poses() const;
  // All keyframes ever made, in temporal order.
  std::vector<KeyframePose> KeyframeTrajectory() const;
  OdometryStatistics Statistics() const;

 private:
  class Impl;
  friend class OdometryPeer;  // of the tests
  explicit Odometry(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace cairn::direct

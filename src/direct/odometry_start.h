// How the odometry starts, and starts anew: frames wait with their images until FeatureStart tells a motion with enough
// parallax from the corners that it follows, and the first window of keyframes, built from that, bears it out in their
// images. Where it does not, all begins anew with the newest frame as the reference. A start that stands is still
// doubted for a while (direct/start_confirmation.h), with the same corners followed on, and may be redone.
//
// Poses: camera from the start's reference, which becomes the origin of the segment's frame "direct"; the median
// inverse depth is 1. The odometry gives the frames that waited their poses once the window stands.
//
// Only the thread that calls Odometry::OptimizeNext() uses it; it takes no lock itself.
#pragma once

#include <cstddef>
#include <functional>
#include <utility>

#include "direct/feature_start.h"
#include "direct/first_window.h"
#include "direct/odometry_options.h"
#include "direct/retained_frames.h"
#include "geometry/pinhole.h"

namespace cairn::direct {

class OdometryStart {
 public:
  // `camera` is at full resolution. `retained` and `first_window` are the odometry's, and outlive it.
  OdometryStart(const OdometryOptions& options, const Pinhole& camera, RetainedFrames* retained,
                FirstWindow* first_window);

  // One more frame that waits; it is retained. After a success the window has the first keyframes, numbered as
  // `numbers` says, and one pose of the result belongs to each retained frame from the reference on; otherwise the
  // window is empty, and the message says what the start waits for.
  StartResult Add(const Frame& frame, std::size_t position, const SegmentNumbers& numbers);
  // The first window of another answer for the frames since the reference. Where that fails, all begins anew.
  bool Redo(const StartResult& better, const SegmentNumbers& numbers);
  // A start that stands for want of a better answer (StartVerdict::kUnproven): corners are followed anew, from the
  // newest frame, which is retained already; those before it wait on.
  void LookAgain();
  // One more frame since, already retained. A success is another start, of the frames since the newest reference, that
  // has begun nothing yet: Redo() does.
  StartResult FollowAgain();
  // Forgets corners and retained frames: the start is trusted, or what it began has ended.
  void Reset();

  // What StartConfirmation follows on.
  FeatureStart& corners() { return corners_; }

  // For tests: what every start passes through before it is used.
  void Alter(std::function<void(StartResult*)> alter) { alter_ = std::move(alter); }

 private:
  void BeginWithNewest();

  FeatureStart corners_;
  RetainedFrames* const retained_;
  FirstWindow* const first_window_;
  std::function<void(StartResult*)> alter_;
};

}  // namespace cairn::direct

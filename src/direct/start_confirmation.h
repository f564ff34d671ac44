// Was the start right? It is doubted until the camera has moved on by about as much again: the corners of the start are
// followed all the while, and two-view geometry and bundle adjustment over the longer way must not explain them much
// better than the odometry's poses do.
//
// What follows from the answer is the odometry's: a start found wrong is undone, the new answer builds another first
// window, and all frames, which were kept, are tracked again. Packets are held back meanwhile.
//
// Only the thread that calls Odometry::OptimizeNext() uses it; it takes no lock: the poses are copied for it.
#pragma once

#include <optional>
#include <vector>

#include "direct/feature_start.h"
#include "geometry/se3.h"

namespace cairn::direct {

enum class StartVerdict { kOpen, kRight, kWrong };

class StartConfirmation {
 public:
  // `corners` are those of the start, and outlive it.
  explicit StartConfirmation(FeatureStart* corners) : corners_(corners) {}

  // The start that `corners` have just found is in doubt: it is made of all frames since the reference.
  void Begin() { start_frames_ = corners_->FrameCount(); }

  // One more frame after it, which was `tracked` or lost. `direct_from_camera` are the odometry's poses of all frames
  // since and with the start's reference, in frame "direct" of the segment; none where it was lost. With kWrong,
  // `better` is the answer that explains the corners better, for the same frames.
  StartVerdict Judge(const Frame& frame, bool tracked, const std::vector<std::optional<SE3>>& direct_from_camera,
                     StartResult* better);

 private:
  bool MovedOn(const std::vector<std::optional<SE3>>& direct_from_camera) const;
  bool IsWrong(const std::vector<std::optional<SE3>>& direct_from_camera, StartResult* better) const;

  FeatureStart* const corners_;
  int start_frames_ = 0;  // from the reference to the last one of the start
};

}  // namespace cairn::direct

// Was the start right? It is doubted until the camera has moved on by about as much again: the corners of the start are
// followed all the while, and two-view geometry and bundle adjustment over the longer way must not explain them much
// better than the odometry's poses do.
//
// A view that turns away fast, or blurs, takes its corners along before the camera has moved. In such a view next to no
// parallax and a rotation that is a little wrong look alike, and a start may stand on nothing; what is built on it gets
// ever other scales. It is not undone for that, as most such starts are good: it stays in doubt until other corners
// tell a motion by themselves. If the odometry's explains that one as well, the camera has to move on beyond it; two in
// a row that it does not explain undo the start.
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

enum class StartVerdict {
  kOpen,
  kRight,
  kWrong,     // another answer explains the corners better
  kUnproven,  // the corners were lost before the camera had moved on: nobody can tell
};

// Of two mean squared errors of corners: is the first beyond what noise and a little luck make of the second?
bool ExplainsClearlyWorse(double squared_px2, double than_px2);

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

  // After kUnproven: do the odometry's poses explain the corners of a `second` start, of later frames, as well as that
  // does? Poses of all frames since and with its reference. kUnproven: those corners prove nothing, either, as in a
  // blur, where they fit no motion well for the parallax that they show.
  StartVerdict Compare(const StartResult& second, const std::vector<std::optional<SE3>>& direct_from_camera) const;

 private:
  bool MovedOn(const std::vector<std::optional<SE3>>& direct_from_camera) const;
  bool IsWorse(const std::vector<std::optional<SE3>>& direct_from_camera, const StartResult& better) const;
  bool IsWrong(const std::vector<std::optional<SE3>>& direct_from_camera, StartResult* better) const;

  FeatureStart* const corners_;
  int start_frames_ = 0;  // from the reference to the last one of the start
};

}  // namespace cairn::direct

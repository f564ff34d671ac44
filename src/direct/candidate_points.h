// The points' way into the window: candidates are chosen in a keyframe, traced in the images that follow until their
// depth is known to a few pixels along the epipolar line, and activated where the newest keyframe lacks points. None is
// chosen, traced or activated behind an obstacle.
//
// Pixels are those of level 0, depths those of the window's keyframes. Only the thread that calls
// Odometry::OptimizeNext() uses it: no lock.
#pragma once

#include <vector>

#include "direct/cover_mask.h"
#include "direct/keyframe.h"
#include "direct/odometry_options.h"
#include "direct/pixel_selector.h"
#include "direct/point_tracer.h"
#include "direct/spacing_grid.h"
#include "direct/view_cells.h"
#include "direct/window.h"

namespace cairn::direct {

class CandidatePoints {
 public:
  // `window` and `cover` are the odometry's, and outlive it.
  CandidatePoints(const OdometryOptions& options, const PyramidGeometry& geometry, Window* window,
                  const CoverMask* cover);

  // A segment begins: nothing is known of how densely points can be had.
  void ResetSpacing() { spacing_px_ = kFirstSpacingPx; }
  // The candidates of a new keyframe, instead of those it has.
  void Select(Keyframe* keyframe);
  // Narrows the depths of one keyframe's candidates by an image; `pair` from the keyframe to the image.
  void TraceOne(const ImagePyramid& image, const PairProjection& pair, Keyframe* host) const;
  // The same for all keyframes of the window. `covered` are the cells of the image behind an obstacle.
  void Trace(const FrameData& data, const SE3& camera_from_direct, const AffineLight& light, const CellSet& covered);
  // Candidates become points of the window; `goes` says which keyframes are about to leave it, and leave theirs behind.
  void Activate(const std::vector<bool>& goes);

 private:
  static constexpr double kFirstSpacingPx = 4.0;

  bool Hidden(const PairProjection& pair, const ImmaturePoint& point, const CellSet& covered) const;
  void AdaptSpacing();

  const OdometryOptions options_;
  const PyramidGeometry geometry_;
  Window* const window_;
  const CoverMask* const cover_;
  TraceOptions trace_options_;
  PixelSelector selector_;
  std::vector<SelectedPixel> selected_;  // keeps its memory
  SpacingGrid spacing_;
  double spacing_px_ = kFirstSpacingPx;  // between the points of the newest keyframe, steers their number
};

}  // namespace cairn::direct

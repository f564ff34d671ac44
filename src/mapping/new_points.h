// New points for a keyframe: from depths of the direct module (Lee and Civera, RA-L 2019, Sec. V-B), and by
// triangulation with covisible keyframes along epipolar lines (Mur-Artal et al., "ORB-SLAM", T-RO 2015, Sec. VI-C).
// With known poses and a known range of depths the part of the line that can hold the match is short, so it is searched
// over the feature grid; words are not needed.
#pragma once

#include <span>
#include <vector>

#include "map/edit.h"
#include "mapping/feature_mapper_options.h"
#include "mapping/keypoint_depth.h"

namespace cairn::mapping {

// Points for features that have a known depth and no point yet. `map_per_direct` scales the depths. Returns the new
// points.
std::vector<PointId> PointsFromDepths(map::Edit& edit, KeyframeId keyframe, std::span<const KeypointDepth> depths,
                                      double map_per_direct);

// Inverse depths (1 / z) between which a keyframe's scene lies, in map units, widened; from the points it observes.
struct DepthRange {
  double min_inverse = 0.0;
  double max_inverse = 0.0;
  double median_depth = 0.0;

  bool valid() const { return max_inverse > 0.0; }
};
DepthRange DepthRangeOf(const map::Edit& edit, KeyframeId keyframe);

struct TriangulationOptions {
  double min_parallax_deg = 1.0;
  double min_baseline_share = 0.01;        // of the median scene depth
  double max_chi_square = 5.991;           // of a reprojection error whitened by scale^octave, 2 degrees of freedom
  double max_epipolar_chi_square = 3.841;  // of the distance to the epipolar line, 1 degree of freedom
  double extra_sigma_px = 0.0;             // of the poses, added to the features' own
  int covered_points = 0;                  // see CoveredFeatures(); 0: none is covered
  int covered_age = 10;
  int max_distance = 60;  // Hamming, bits
  double max_ratio = 0.85;
};

// Where a keyframe observes enough points that are long known, more of them would make the map denser and not wider,
// and where a camera comes again and again they would pile up: the features in those of 8 x 8 cells of the image that
// hold at least `points_per_cell` (0: no limit) points first seen at least `min_age` keyframes ago have 1, all others
// 0.
std::vector<std::uint8_t> CoveredFeatures(const map::Edit& edit, KeyframeId keyframe, int points_per_cell, int min_age);

// For each feature of `keyframe` without a point: the best match along the epipolar line in each of `neighbours` in
// turn, until one passes all gates. The search covers `range`, or what the feature's own depth leaves of it. Returns
// the new points; their derived fields are set.
std::vector<PointId> TriangulateWith(map::Edit& edit, KeyframeId keyframe, std::span<const KeyframeId> neighbours,
                                     std::span<const KeypointDepth> depths, double map_per_direct,
                                     const DepthRange& range, const TriangulationOptions& options);

}  // namespace cairn::mapping

// Joins points that are the same: those of a keyframe are projected into the keyframes around it and the other way
// round; a feature that a point falls on either becomes a further observation of it, or shows that its own point is the
// same one (Mur-Artal et al., "ORB-SLAM", T-RO 2015, Sec. VI-C).
#pragma once

#include <span>
#include <vector>

#include "map/edit.h"
#include "mapping/grid_cache.h"

namespace cairn::mapping {

struct FusionOptions {
  double radius_px = 3.0;         // of the search, at octave 0
  int max_distance = 50;          // Hamming, bits
  double max_chi_square = 5.991;  // of the distance from the projection, whitened by scale^octave
  double extra_sigma_px = 0.0;    // of the poses, added to the features' own
};

struct FusionCounts {
  int observations = 0;  // added
  int fused = 0;         // points joined with another, and gone
};

// Projects `points` into `keyframe`. Points that are gone, or that the keyframe observes already, are passed over.
FusionCounts FuseInto(map::Edit& edit, KeyframeId keyframe, std::span<const PointId> points, GridCache& grids,
                      const FusionOptions& options);

// Both ways between a keyframe and those around it.
FusionCounts FuseAround(map::Edit& edit, KeyframeId keyframe, std::span<const KeyframeId> around, GridCache& grids,
                        const FusionOptions& options);

// The `first` best covisible keyframes of a keyframe, `second` best of each of these, and `more`; without itself or
// doubles, in that order.
std::vector<KeyframeId> SurroundingKeyframes(const map::Edit& edit, KeyframeId keyframe, int first, int second,
                                             std::span<const KeyframeId> more);

}  // namespace cairn::mapping

// What two virtual recordings of one world see in common: from which moment on one of them could be placed in a map
// made of the other.
#pragma once

#include <vector>

#include "base/status.h"
#include "synth/sequence.h"

namespace cairn::synth {

struct OverlapOptions {
  // Points of the surface in view that are tried, across the image; as dense down it.
  int columns = 48;
  // Two images see a point alike enough for features to match if they see it from directions no more than this apart
  // and from distances (in focal lengths: sizes in the image) of no more than this ratio.
  double max_angle_rad = 0.7;
  double max_distance_ratio = 2.0;
  // Of the other recording one image in so many seconds is tried.
  double step_s = 0.2;

  absl::Status Validate() const;
};

// For each image of `sequence` the largest share of the surface in view, in [0, 1], that a single image of `other`
// shows too: in its view, not hidden, and alike enough. `other` has to be of the same world; both cameras count as
// pinholes.
absl::StatusOr<std::vector<double>> SharedViews(const Sequence& sequence, const SequenceOptions& other,
                                                const OverlapOptions& options = {});

}  // namespace cairn::synth

// Where the map knows more than the odometry that it was made from: where its points outlast the odometry's window,
// seen from keyframes that were never in it together. There the refined keyframes are the better trajectory. Where
// nothing is remembered for longer, both see the same, the odometry in every image and with more of its pixels, and its
// own trajectory is reported. (Lee and Civera, "Loosely-Coupled Semi-Direct Monocular SLAM", RA-L 2019, Sec. V-E,
// choose one of the two for all of a run, by the collinearity of covisible keyframes: docs/deviations.md.)
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "base/status.h"
#include "map/snapshot.h"
#include "mapping/keyframe_trajectory.h"

namespace cairn::mapping {

struct MapMemoryOptions {
  int window_keyframes = 7;  // that the odometry optimizes together
  // Of the points that the keyframes around one see, this share must outlast the window; 0: all is refined. Measured:
  // 0 to 0.1 where the odometry is as good or better (a fast desk, markers seen for seconds), 0.2 to 0.6 where it is
  // worse (corridors, a street, a kitchen).
  double min_share = 0.15;

  absl::Status Validate() const;
};

// A part [begin, end) of a keyframe trajectory, in one segment.
struct Stretch {
  std::size_t begin = 0;
  std::size_t end = 0;
};

// In which the odometry's trajectory is reported, in temporal order. A run of keyframes of one kind no longer than the
// window tells nothing, and goes with what is before it (at the beginning of a segment with what is after).
std::vector<Stretch> DirectStretches(const std::vector<KeyframeTrajectory::Entry>& entries, const map::Snapshot& map,
                                     const MapMemoryOptions& options);

struct TrajectoryChoice {
  bool refined = true;  // of most keyframes
  std::string reason;   // for people
};

// `stretches`: as above, none if the refined trajectory is reported throughout because a loop was closed or the lens
// corrected (the odometry knew of neither).
TrajectoryChoice ChooseTrajectory(const std::vector<KeyframeTrajectory::Entry>& entries,
                                  std::span<const Stretch> stretches, bool loop_closed, bool lens_corrected);

}  // namespace cairn::mapping

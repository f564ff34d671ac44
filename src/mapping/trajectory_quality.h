// How sure the poses of a session are, after the similarity that fits its trajectory best to the truth (so trajectories
// are compared), and whether its parts hold together at all. Three errors, independent of each other:
//
//   noise     what the observations leave open (optimization/pose_covariance.h), times two: matches are no independent
//             measurements
//   model     what lens, shutter and wrong matches bend: in proportion to the depth of the scene and to the cube of
//             how badly the observations fit, the law of tracking/map_error.h at the residuals that an adjusted map
//             leaves
//   odometry  in stretches where its trajectory is reported (map_memory.h): how far it lies from the refined one; and
//             everywhere, what the scale may differ by across a place that few points carry it over
//
// Measured laws, not derived ones: docs/benchmarks.md has the normalized errors.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/time.h"
#include "map/snapshot.h"
#include "mapping/keyframe_trajectory.h"
#include "mapping/map_memory.h"

namespace cairn::mapping {

struct TrajectoryQualityOptions {
  double noise_factor = 2.0;
  double depth_share = 0.03;     // of the median depth: what a map errs whose observations are 1 px (at octave 0) off
  double rotation_rad = 0.0077;  // likewise
  // Points seen at least three times, on both sides of each moment: with so many the quality is 1/2, with fewer the
  // scale may differ by a tenth of the trajectory's spread for each time that they are too few.
  int carrying_points = 100;
  double spread_share = 0.1;  // of the trajectory's spread: a standard deviation of so much is a quality of 1/2
  int max_keyframes = 200;    // with more the noise is left out
};

// Below it a trajectory, or a pose, is not to be relied on.
inline constexpr double kQualityLimit = 0.5;

// Standard deviations per axis.
struct KeyframeSigma {
  double position = 0.0;  // map units; 0: not known
  double rotation_rad = 0.0;
};

struct TrajectoryQuality {
  std::vector<KeyframeSigma> keyframes;  // per trajectory keyframe
  double quality = 0.0;                  // of the whole, 0 to 1
  double position_sigma = 0.0;           // root mean square of the keyframes', per axis
  double spread = 0.0;                   // root mean square distance of the keyframes from their middle
  int weakest_points = 0;                // that carry the scale where fewest do, ...
  TimeNs weakest_ns = 0;                 // ... after that keyframe
  std::string warning;                   // for people; empty: none
};

// `refined`: all keyframes of a session that ended (KeyframeTrajectory::Resolve), `reported`: the same as reported,
// with the odometry's poses in `direct`.
TrajectoryQuality AssessTrajectory(const std::shared_ptr<const map::Snapshot>& map,
                                   std::span<const TrajectoryKeyframe> refined,
                                   std::span<const TrajectoryKeyframe> reported, std::span<const Stretch> direct,
                                   const TrajectoryQualityOptions& options = {});

}  // namespace cairn::mapping

// How good a map is, in distributions: of its points, its keyframes and the observations between them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "map/snapshot.h"

namespace cairn::inspect {

struct Distribution {
  std::string name;  // "observations_per_point", with the unit as suffix
  std::string what;  // for people
  std::string unit;  // of lengths, which the name does not tell: "m", "map units"
  std::int64_t count = 0;
  double min = 0.0, median = 0.0, mean = 0.0, p90 = 0.0, max = 0.0;  // 0 without values
  // From `low`, `step` wide each, and with values beyond the last one counted in that. The upper end of the last is at
  // about the 99th percentile, so that a few far values leave the others apart.
  double low = 0.0, step = 0.0;
  std::vector<std::int64_t> bins;
};

inline constexpr int kBins = 24;

// `whole`: values are whole numbers, and so are the steps. Values that are not finite are left out.
Distribution Distribute(std::string name, std::string what, std::vector<double> values, bool whole);

// Track lengths (observations, sessions, seconds), reprojection errors of points and keyframes, parallax, depth, share
// found, points and covisible keyframes per keyframe. Lengths as of Placed() (measures.h), of what shares a unit: all
// aligned components, or without any the one with most keyframes. A `session` counts its own
// keyframes, and the points whose reference keyframe is one of them; none: all.
std::vector<Distribution> Statistics(const map::Snapshot& map, SessionId session = {});

}  // namespace cairn::inspect

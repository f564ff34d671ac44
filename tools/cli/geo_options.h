// Where a map is on the earth, as the command line says it.
#pragma once

#include <string>

#include "api/map_alignment.h"
#include "base/status.h"

namespace cairn::cli {

struct GeoOptions {
  std::string geo;            // "LAT LON HEIGHT" of the world's origin; "none": the map forgets its anchor
  double heading_deg = 90.0;  // to which the world's axis points that follows `up` (x after z), clockwise from north
  std::string up = "z";       // axis of the world that points upwards: x, y, z, -x, -y, -z
  std::string positions;      // file of geographic positions of keyframes
};

// From --geo: a GeoAnchor or NoGeoAnchor. A UsageError says what is wrong.
absl::StatusOr<decltype(api::AlignRequest::by)> AnchorOf(const GeoOptions& options);

// Lines `time latitude longitude height`, or under a header that begins with "keyframe" `keyframe latitude longitude
// height`: degrees, and metres above the ellipsoid. Errors name file and line.
absl::StatusOr<api::GeoPositions> ReadGeoPositions(const std::string& path);

// "60.169900, 24.938400, 30.00 m; the world's x axis points to 90.0 deg, its z axis upwards".
std::string DescribeAnchor(const map::GeoAnchor& anchor);

}  // namespace cairn::cli

// cairn align by what somebody has measured: positions, distances, the direction of gravity.
#pragma once

#include <string>
#include <vector>

#include "api/map_alignment.h"
#include "base/status.h"

namespace cairn::cli {

struct KnownPlacesOptions {
  std::string positions;               // a file
  std::vector<std::string> distances;  // "point 12 point 57 3.2"
  std::string gravity;                 // "0 9.81 0", or "cameras"

  bool empty() const { return positions.empty() && distances.empty() && gravity.empty(); }
};

// Errors of the file name its line; those of the options are UsageErrors.
absl::StatusOr<api::KnownPlaces> ReadKnownPlaces(const KnownPlacesOptions& options);
void PrintKnownAlignment(const std::string& map, const api::AlignAnswer& answer, bool json);

}  // namespace cairn::cli

// cairn align by what somebody has measured: positions, distances, the direction of gravity.
#pragma once

#include <string>
#include <vector>

namespace cairn::cli {

struct KnownPlacesOptions {
  std::string positions;               // a file
  std::vector<std::string> distances;  // "point 12 point 57 3.2"
  std::string gravity;                 // "0 9.81 0", or "cameras"
  bool overwrite = false;
  bool force = false;

  bool empty() const { return positions.empty() && distances.empty() && gravity.empty(); }
};

// Aligns the map file and says how; the verb's exit code.
int AlignByKnown(const std::string& map, const KnownPlacesOptions& options, bool json);

}  // namespace cairn::cli

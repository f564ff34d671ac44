// Makes a map of rows of which some are missing one that hangs together again (recover.h).
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/status.h"
#include "store/map_assembly.h"

namespace cairn::store {

struct Mended {
  std::vector<std::int64_t> lost_keyframes;  // whose rows were there in part
  std::vector<std::string> notes;            // what was made good
};

// Afterwards AssembleMap() takes the rows. DataLoss (without a fault) if no keyframe is left.
absl::StatusOr<Mended> Mend(MapRows* rows);

}  // namespace cairn::store

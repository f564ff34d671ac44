// Saves what is good of a damaged map as a map of its own. Rows whose checksums hold are taken from wherever they lie
// (salvage.h); what they need of what is lost is made good where that is possible without guessing (neighbours, the
// spanning tree, a session's entry), and else left out with them: a keyframe without its features, camera or points,
// a point that no keyframe is left to see.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/status.h"
#include "store/map_store.h"

namespace cairn::store {

struct RecoverOptions {
  // Vocabulary to store if the one in the file is lost; used only if its hash is the one that the map names.
  std::string vocabulary = {};
  std::uint64_t vocabulary_hash = 0;
};

struct RecoverReport {
  Revision revision = 0;  // of the new map: the one after the newest that was found
  std::int64_t keyframes = 0;
  std::int64_t points = 0;
  // What there had been, as far as that is known (-1: not), and is not any more.
  std::int64_t keyframes_lost = -1;
  std::int64_t points_lost = -1;
  std::vector<std::int64_t> lost_keyframes;  // ids, of those of which something was found
  bool vocabulary = false;                   // in the new map
  std::vector<Finding> findings;             // what was wrong, row by row
  std::vector<std::string> notes;            // what was made good, and what to know
};

// `good` must not exist. `bad`, and what lies beside it, is only read. Faults: of opening and writing files; kDamaged
// if there is nothing to be saved: no keyframe with its camera, features and points.
absl::StatusOr<RecoverReport> RecoverMap(const std::string& bad, const std::string& good,
                                         const RecoverOptions& options = {});

}  // namespace cairn::store

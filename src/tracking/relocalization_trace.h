// What a search for an image in a map went through, for people who ask why it ended as it did. The search is the one
// of Relocalizer, to the bit; it only keeps notes.
#pragma once

#include <vector>

#include "tracking/group_matcher.h"
#include "tracking/relocalizer.h"

namespace cairn::tracking {

// One group of keyframes whose points were matched, and what came of it.
struct TracedGroup {
  std::vector<KeyframeId> keyframes;  // the candidate that founds it first
  std::vector<GroupMatch> matches;    // the most trustworthy first
  bool tried = false;                 // a pose was looked for
  Relocalization attempt;             // if so: its stage, reason, counts and place
};

struct RelocalizationTrace {
  std::vector<place::Candidate> candidates;  // best first; ids are those of keyframes
  std::vector<TracedGroup> groups;           // in the order in which they were matched
};

// Relocalizer::Relocalize with notes.
absl::StatusOr<Relocalization> RelocalizeTraced(const RelocalizerOptions& options, const map::Snapshot& map,
                                                const PlaceIndex& places, const Pinhole& pinhole,
                                                const image::Features& features, const SearchArea& area,
                                                RelocalizationTrace* trace);

}  // namespace cairn::tracking

// Where in a map an image may be: keyframes that share words with it, grouped by covisibility (Mur-Artal, Tardos, "Fast
// relocalisation and loop closing in keyframe-based SLAM", ICRA 2014, Sec. III-B).
#pragma once

#include <unordered_set>
#include <vector>

#include "base/ids.h"
#include "map/snapshot.h"
#include "place/index.h"

namespace cairn::tracking {

struct CandidateGroup {
  double score = 0.0;
  std::vector<KeyframeId> keyframes;  // the candidate that founds it first
};

// One of each candidate and its `size` - 1 best covisible keyframes, best first. A group's score is the sum of its
// members'.
std::vector<CandidateGroup> FormGroups(const map::Snapshot& map, const std::vector<place::Candidate>& candidates,
                                       int size);

// The best of them, at most `most`, none below `min_score`. What is founded by a member of a better one, or of `taken`,
// is left out.
std::vector<CandidateGroup> SelectGroups(const std::vector<CandidateGroup>& groups, int most, double min_score,
                                         std::unordered_set<KeyframeId> taken = {});

}  // namespace cairn::tracking

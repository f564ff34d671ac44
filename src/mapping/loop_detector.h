// Which keyframes might show the same place as the newest one, long after: those that share most words, are not linked
// to it, and belong to a place that several keyframes in a row have found (Mur-Artal, Montiel, Tardos, "ORB-SLAM",
// T-RO 2015, Sec. VII-A).
#pragma once

#include <set>
#include <vector>

#include "map/snapshot.h"
#include "mapping/loop_options.h"
#include "tracking/place_index.h"

namespace cairn::mapping {

class LoopDetector {
 public:
  explicit LoopDetector(const LoopOptions& options) : options_(options) {}

  // Candidates for `keyframe`, the newest one inserted, best first; to be called once for each. `places` is of the same
  // revision as `map`.
  std::vector<KeyframeId> Detect(const map::Snapshot& map, const tracking::PlaceIndex& places, KeyframeId keyframe);

  // After a loop: what was found before does not count.
  void Reset();

 private:
  // A place: a candidate and the keyframes covisible with it; how many keyframes in a row have found it.
  struct Group {
    std::set<KeyframeId> keyframes;
    int detections = 1;
  };

  const LoopOptions options_;
  std::vector<Group> groups_;  // found by the keyframe before
  int since_loop_ = 0;
};

}  // namespace cairn::mapping

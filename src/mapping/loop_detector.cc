#include "mapping/loop_detector.h"

#include <algorithm>
#include <unordered_map>
#include <unordered_set>

namespace cairn::mapping {
namespace {

constexpr int kGroupSize = 10;  // covisible keyframes whose scores count with a candidate's

// The keyframe itself, what is linked to it, and what is covisible with that: no loop, but the place where it is.
std::unordered_set<KeyframeId> Near(const map::Snapshot& map, const map::Keyframe& keyframe) {
  std::unordered_set<KeyframeId> near = {keyframe.id};
  if (keyframe.parent) near.insert(keyframe.parent);
  near.insert(keyframe.children.begin(), keyframe.children.end());
  for (const map::CovisibilityEdge& edge : keyframe.covisible) {
    near.insert(edge.keyframe);
    if (edge.shared_points < map::kMinCovisiblePoints) continue;
    for (const map::CovisibilityEdge& further : map.keyframe(edge.keyframe).covisible) {
      if (further.shared_points >= map::kMinCovisiblePoints) near.insert(further.keyframe);
    }
  }
  return near;
}

// Candidates by the score of their groups: the best member of each good group, best group first.
std::vector<KeyframeId> BestOfGroups(const map::Snapshot& map, const std::vector<place::Candidate>& candidates,
                                     double min_share) {
  std::unordered_map<KeyframeId, double> score_of;
  for (const place::Candidate& candidate : candidates) score_of[KeyframeId(candidate.id)] = candidate.score;
  std::vector<std::pair<double, KeyframeId>> groups;  // (-score, best member)
  for (const place::Candidate& candidate : candidates) {
    double sum = candidate.score, best_score = candidate.score;
    KeyframeId best(candidate.id);
    for (const KeyframeId id : map::BestCovisible(map.keyframe(best), kGroupSize)) {
      const auto scored = score_of.find(id);
      if (scored == score_of.end()) continue;
      sum += scored->second;
      if (scored->second > best_score) {
        best = id;
        best_score = scored->second;
      }
    }
    groups.emplace_back(-sum, best);
  }
  std::sort(groups.begin(), groups.end());
  std::vector<KeyframeId> kept;
  for (const auto& [score, id] : groups) {
    if (-score < min_share * -groups.front().first) break;
    if (std::find(kept.begin(), kept.end(), id) == kept.end()) kept.push_back(id);
  }
  return kept;
}

}  // namespace

void LoopDetector::Reset() {
  groups_.clear();
  since_loop_ = 0;
}

std::vector<KeyframeId> LoopDetector::Detect(const map::Snapshot& map, const tracking::PlaceIndex& places,
                                             KeyframeId keyframe_id) {
  ++since_loop_;
  const map::Keyframe& keyframe = map.keyframe(keyframe_id);
  const std::unordered_set<KeyframeId> near = Near(map, keyframe);
  place::QueryOptions everything;
  everything.min_common_share = 0.0;
  everything.max_results = 0;
  // Other components have frames of their own (mapping/component_join.h).
  everything.exclude = [&](std::uint32_t id) { return map.keyframe(KeyframeId(id)).component != keyframe.component; };
  const auto scored = places.Query(places.Transform(keyframe.features.Get()->features).bow, everything);

  // As alike as the least alike of those that are known to see the same.
  double min_score = 1.0;
  std::uint32_t max_common = 0;
  for (const place::Candidate& other : scored) {
    const auto edge = std::ranges::find(keyframe.covisible, KeyframeId(other.id), &map::CovisibilityEdge::keyframe);
    if (edge != keyframe.covisible.end() && edge->shared_points >= map::kMinCovisiblePoints) {
      min_score = std::min(min_score, other.score);
    }
    if (!near.contains(KeyframeId(other.id))) max_common = std::max(max_common, other.common_words);
  }
  std::vector<place::Candidate> candidates;
  for (const place::Candidate& other : scored) {
    if (!near.contains(KeyframeId(other.id)) && other.score >= min_score &&
        other.common_words >= options_.min_common_share * max_common) {
      candidates.push_back(other);
    }
  }

  std::vector<Group> found;
  std::vector<KeyframeId> consistent;
  for (const KeyframeId id : BestOfGroups(map, candidates, options_.min_group_share)) {
    Group group;
    group.keyframes.insert(id);
    for (const KeyframeId member : map::BestCovisible(map.keyframe(id))) group.keyframes.insert(member);
    for (const Group& before : groups_) {
      const bool same =
          std::ranges::any_of(group.keyframes, [&](KeyframeId k) { return before.keyframes.contains(k); });
      if (same) group.detections = std::max(group.detections, before.detections + 1);
    }
    if (group.detections >= options_.consistent_detections) consistent.push_back(id);
    found.push_back(std::move(group));
  }
  groups_ = std::move(found);
  if (since_loop_ <= options_.min_keyframes_between) return {};
  return consistent;
}

}  // namespace cairn::mapping

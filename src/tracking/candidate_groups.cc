#include "tracking/candidate_groups.h"

#include <algorithm>
#include <unordered_map>
#include <utility>

namespace cairn::tracking {

std::vector<CandidateGroup> FormGroups(const map::Snapshot& map, const std::vector<place::Candidate>& candidates,
                                       int size) {
  std::unordered_map<KeyframeId, double> score_of;
  for (const place::Candidate& candidate : candidates) score_of[KeyframeId(candidate.id)] = candidate.score;
  std::vector<CandidateGroup> groups;
  for (const place::Candidate& candidate : candidates) {
    const map::Keyframe* keyframe = map.keyframes().Find(KeyframeId(candidate.id));
    if (keyframe == nullptr) continue;
    CandidateGroup group;
    group.keyframes.push_back(keyframe->id);
    group.score = candidate.score;
    if (size > 1) {
      for (const KeyframeId id : map::BestCovisible(*keyframe, size - 1)) {
        group.keyframes.push_back(id);
        if (const auto found = score_of.find(id); found != score_of.end()) group.score += found->second;
      }
    }
    groups.push_back(std::move(group));
  }
  std::stable_sort(groups.begin(), groups.end(), [](const CandidateGroup& a, const CandidateGroup& b) {
    return a.score != b.score ? a.score > b.score : a.keyframes[0] < b.keyframes[0];
  });
  return groups;
}

std::vector<CandidateGroup> SelectGroups(const std::vector<CandidateGroup>& groups, int most, double min_score,
                                         std::unordered_set<KeyframeId> taken) {
  std::vector<CandidateGroup> chosen;
  for (const CandidateGroup& group : groups) {
    if (static_cast<int>(chosen.size()) >= most || group.score < min_score) break;
    if (taken.contains(group.keyframes[0])) continue;
    taken.insert(group.keyframes.begin(), group.keyframes.end());
    chosen.push_back(group);
  }
  return chosen;
}

}  // namespace cairn::tracking

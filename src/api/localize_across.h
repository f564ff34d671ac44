// "Where is this camera?", asked of several maps: which of them the image is of, or that it may be of more than one.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "api/localizer.h"
#include "base/status.h"
#include "map/entities.h"

namespace cairn::api {

inline constexpr std::size_t kMaxMapsAcross = 64;

// Of one map.
struct AnswerOfMap {
  std::string map;
  absl::Status status;  // why it could not be asked; then there is no answer
  LocalizeAnswer answer;
};

struct AcrossAnswer {
  std::string map;         // where the image was located; empty: nowhere, or it is ambiguous
  bool ambiguous = false;  // several maps fit about as well, and they are not copies of one; or several places of one
  // Of an ambiguous answer: the maps that fit about as well, best first.
  std::vector<std::string> rivals;
  // Those that located it first, most inliers first; then the others by name.
  std::vector<AnswerOfMap> answers;

  // Of `map`; null: none.
  const LocalizeAnswer* located() const { return map.empty() ? nullptr : &answers.front().answer; }
};

// The one that located the image with most inliers, unless it has rivals: other maps (of another id), or places of one
// map, that fit with at least `rival_share` of its inliers. That share is the one of places within a map
// (tracking::RelocalizerOptions::max_rival_share).
AcrossAnswer JudgeAcross(std::vector<AnswerOfMap> answers, double rival_share);

}  // namespace cairn::api

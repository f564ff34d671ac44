#include "api/localize_across.h"

#include <algorithm>

namespace cairn::api {

AcrossAnswer JudgeAcross(std::vector<AnswerOfMap> answers) {
  // Of two places that look alike the wrong one keeps a part of the matches; where two maps are of the same place, both
  // keep most of them.
  constexpr double kRivalShare = 0.5;
  AcrossAnswer across;
  across.answers = std::move(answers);
  std::ranges::stable_sort(across.answers, [](const AnswerOfMap& x, const AnswerOfMap& y) {
    if (x.answer.localized != y.answer.localized) return x.answer.localized;
    if (x.answer.localized && x.answer.inliers != y.answer.inliers) return x.answer.inliers > y.answer.inliers;
    return x.map < y.map;
  });
  if (across.answers.empty() || !across.answers.front().answer.localized) return across;
  const AnswerOfMap& best = across.answers.front();
  across.ambiguous = std::ranges::any_of(across.answers, [&](const AnswerOfMap& other) {
    return other.answer.localized && other.answer.map_id != best.answer.map_id &&
           other.answer.inliers >= kRivalShare * best.answer.inliers;
  });
  if (!across.ambiguous) across.map = best.map;
  return across;
}

}  // namespace cairn::api

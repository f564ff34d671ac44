#include "api/localize_across.h"

#include <algorithm>

namespace cairn::api {

bool AreRivals(const LocalizeAnswer& best, const LocalizeAnswer& other) {
  // Of two places that look alike the wrong one keeps a part of the matches; where two maps are of the same place, both
  // keep most of them.
  constexpr double kRivalShare = 0.5;
  return other.localized && other.map_id != best.map_id && other.inliers >= kRivalShare * best.inliers;
}

AcrossAnswer JudgeAcross(std::vector<AnswerOfMap> answers) {
  AcrossAnswer across;
  across.answers = std::move(answers);
  std::ranges::stable_sort(across.answers, [](const AnswerOfMap& x, const AnswerOfMap& y) {
    if (x.answer.localized != y.answer.localized) return x.answer.localized;
    if (x.answer.localized && x.answer.inliers != y.answer.inliers) return x.answer.inliers > y.answer.inliers;
    return x.map < y.map;
  });
  if (across.answers.empty() || !across.answers.front().answer.localized) return across;
  const AnswerOfMap& best = across.answers.front();
  across.ambiguous = std::ranges::any_of(
      across.answers, [&](const AnswerOfMap& other) { return AreRivals(best.answer, other.answer); });
  if (!across.ambiguous) across.map = best.map;
  return across;
}

}  // namespace cairn::api

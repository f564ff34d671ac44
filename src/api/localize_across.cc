#include "api/localize_across.h"

#include <algorithm>

namespace cairn::api {
namespace {

// Of the best place, also where the map has several that fit.
int BestInliers(const LocalizeAnswer& answer) {
  if (answer.localized) return answer.inliers;
  return answer.rivals.empty() ? 0 : answer.rivals.front().inliers;
}

}  // namespace

AcrossAnswer JudgeAcross(std::vector<AnswerOfMap> answers, double rival_share) {
  AcrossAnswer across;
  across.answers = std::move(answers);
  std::ranges::stable_sort(across.answers, [](const AnswerOfMap& x, const AnswerOfMap& y) {
    if (x.answer.localized != y.answer.localized) return x.answer.localized;
    if (x.answer.localized && x.answer.inliers != y.answer.inliers) return x.answer.inliers > y.answer.inliers;
    return x.map < y.map;
  });
  std::vector<const AnswerOfMap*> fitting;
  for (const AnswerOfMap& answer : across.answers) {
    if (BestInliers(answer.answer) > 0) fitting.push_back(&answer);
  }
  if (fitting.empty()) return across;
  std::ranges::stable_sort(fitting, std::ranges::greater(),
                           [](const auto* of_map) { return BestInliers(of_map->answer); });
  const AnswerOfMap& best = *fitting.front();
  const double rival_inliers = rival_share * BestInliers(best.answer);
  std::erase_if(fitting, [&](const auto* of_map) { return BestInliers(of_map->answer) < rival_inliers; });
  across.ambiguous = !best.answer.localized || std::ranges::any_of(fitting, [&](const auto* of_map) {
    return of_map->answer.map_id != best.answer.map_id;
  });
  if (!across.ambiguous) {
    across.map = best.map;
    return across;
  }
  for (const AnswerOfMap* of_map : fitting) across.rivals.push_back(of_map->map);
  return across;
}

}  // namespace cairn::api

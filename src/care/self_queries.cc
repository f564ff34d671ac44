#include "care/self_queries.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "inspect/measures.h"

namespace cairn::care {
namespace {

constexpr double kOneSided95 = 1.645;  // standard deviations
constexpr double kPointsOfOneThatStays = 0.9;

void Count(const inspect::CoverageTest& was, const inspect::CoverageTest& is, QueryCount* count) {
  const bool found_before = was.result == inspect::CoverageResult::kFound;
  const bool found_after = is.result == inspect::CoverageResult::kFound;
  ++count->views;
  count->found_before += found_before ? 1 : 0;
  count->found_after += found_after ? 1 : 0;
  count->lost += found_before && !found_after ? 1 : 0;
}

// With all of its features and nearly all of its points.
bool Stays(const map::Keyframe& before, const map::Keyframe* after) {
  return after != nullptr && after->points.size() == before.points.size() &&
         inspect::NumPoints(*after) >= kPointsOfOneThatStays * inspect::NumPoints(before);
}

}  // namespace

double QueryCount::LossAtMost() const {
  if (views == 0) return 1.0;
  const double n = views, share = lost / n, zz = kOneSided95 * kOneSided95;
  return std::min(1.0,
                  (share + zz / (2.0 * n) + kOneSided95 * std::sqrt(share * (1.0 - share) / n + zz / (4.0 * n * n))) /
                      (1.0 + zz / n));
}

absl::StatusOr<SelfQueries> CompareSelfQueries(const tracking::MapView& before, const tracking::MapView& after,
                                               const inspect::CoverageOptions& options,
                                               const std::function<bool(int, int)>& progress) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  inspect::CoverageOptions alone = options;
  alone.same_view_share = 2.0;  // nobody shares that much
  const std::vector<inspect::ViewPart> parts = {{}, {.right = 0.5}, {.left = 0.5}, {.bottom = 0.5}, {.top = 0.5}};
  std::vector<KeyframeId> all;
  before.map().keyframes().ForEach([&](const auto& keyframe) { all.push_back(keyframe->id); });
  const std::size_t count = std::min(all.size(), static_cast<std::size_t>(options.max_tests));
  SelfQueries queries;
  for (std::size_t i = 0; i < count; ++i) {
    const KeyframeId id = all[i * all.size() / count];
    CAIRN_ASSIGN_OR_RETURN(const auto was, inspect::AskForKeyframe(before, before.map(), id, alone, parts));
    auto is = was;
    if (!Stays(before.map().keyframe(id), after.map().keyframes().Find(id))) {
      CAIRN_ASSIGN_OR_RETURN(is, inspect::AskForKeyframe(after, before.map(), id, alone, parts));
    }
    if (!was.empty() && !is.empty()) {
      for (std::size_t k = 0; k < parts.size(); ++k) Count(was[k], is[k], k == 0 ? &queries.whole : &queries.halves);
    }
    if (progress && !progress(static_cast<int>(i + 1), static_cast<int>(count))) break;
  }
  return queries;
}

}  // namespace cairn::care

#include "care/self_queries.h"

#include <algorithm>
#include <vector>

namespace cairn::care {

absl::StatusOr<SelfQueries> CompareSelfQueries(const tracking::MapView& before, const tracking::MapView& after,
                                               const inspect::CoverageOptions& options,
                                               const std::function<bool(int, int)>& progress) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  std::vector<KeyframeId> all;
  before.map().keyframes().ForEach([&](const auto& keyframe) { all.push_back(keyframe->id); });
  const std::size_t count = std::min(all.size(), static_cast<std::size_t>(options.max_tests));
  SelfQueries queries;
  for (std::size_t i = 0; i < count; ++i) {
    const KeyframeId id = all[i * all.size() / count];
    CAIRN_ASSIGN_OR_RETURN(const auto was, inspect::AskForKeyframe(before, before.map(), id, options));
    CAIRN_ASSIGN_OR_RETURN(const auto is, inspect::AskForKeyframe(after, before.map(), id, options));
    if (was && is) {
      ++queries.views;
      queries.found_before += was->result == inspect::CoverageResult::kFound ? 1 : 0;
      queries.found_after += is->result == inspect::CoverageResult::kFound ? 1 : 0;
    }
    if (progress && !progress(static_cast<int>(i + 1), static_cast<int>(count))) break;
  }
  return queries;
}

}  // namespace cairn::care

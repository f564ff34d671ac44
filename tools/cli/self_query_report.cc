#include "cli/self_query_report.h"

#include <cmath>
#include <cstdio>

#include "absl/strings/str_format.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

nlohmann::ordered_json QueriesAsJson(const care::QueryCount& count) {
  return {{"views", count.views},
          {"found_before", count.found_before},
          {"found_after", count.found_after},
          {"relocalization_loss", count.loss()},
          {"relocalization_loss_at_most", count.LossAtMost()}};
}

// In percent, as it is printed: what is lost below zero, nothing as 0 and not as -0.
double PointsLost(double share) { return std::round(-1000.0 * share) / 10.0 + 0.0; }

void PrintQueries(const char* what, const care::QueryCount& count) {
  std::fputs(text::Wrapped(absl::StrFormat("of %d %s %d were found, then %d: %+.1f points, no worse than %+.1f (95 %%)",
                                           count.views, what, count.found_before, count.found_after,
                                           PointsLost(count.loss()), PointsLost(count.LossAtMost())),
                           "    ", "      ")
                 .c_str(),
             stdout);
}

}  // namespace

nlohmann::ordered_json SelfQueriesAsJson(const care::SelfQueries& queries) {
  nlohmann::ordered_json json = QueriesAsJson(queries.whole);
  json["halves"] = QueriesAsJson(queries.halves);
  return json;
}

void PrintSelfQueries(const care::SelfQueries& queries) {
  std::printf("  relocalization, asked with the map's own keyframes, each taken out:\n");
  PrintQueries("whole images", queries.whole);
  PrintQueries("half images", queries.halves);
}

}  // namespace cairn::cli

#include "cli/where_watch.h"

#include <unistd.h>

#include <iostream>

#include "absl/strings/str_format.h"

namespace cairn::cli {

void WhereWatch::Look() {
  if (quiet_) return;
  const engine::Whereabouts where = session_.Where();
  if (where.located && !seen_) {
    seen_ = true;
    Say(absl::StrFormat("looks like component %u after %.1f s; joined as soon as that is proven",
                        where.located->component.value(), ToSeconds(where.located->time_ns - first_ns_)));
  }
  if (where.joined_ns && !joined_) {
    joined_ = true;
    Say(absl::StrFormat("joined to component %u at %.1f s", where.component.value(),
                        ToSeconds(*where.joined_ns - first_ns_)));
  }
}

// On a terminal over the bar, which is drawn again.
void WhereWatch::Say(const std::string& text) { std::cerr << (isatty(2) != 0 ? "\r\033[K" : "") << text << "\n"; }

}  // namespace cairn::cli

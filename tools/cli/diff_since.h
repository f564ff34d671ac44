// cairn diff MAP --since N: what has changed in one map since a revision, as far as its file remembers: the rows that
// were put or removed. What they were before is not kept.
#pragma once

#include <cstddef>
#include <string>

#include "base/ids.h"
#include "base/status.h"
#include "cli/server_option.h"

namespace cairn::cli {

struct DiffSinceOptions {
  std::string map;
  ServerChoice server;
  Revision since = 0;
  std::size_t limit = 10;  // runs of ids in a line
  bool json = false;
};

// Prints it. FailedPrecondition if the map is not that far, or has forgotten so much.
absl::Status DiffSince(const DiffSinceOptions& options);

}  // namespace cairn::cli

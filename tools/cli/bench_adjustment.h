// cairn bench adjustment: what it costs to store a bundle adjustment of a whole map, and who waits for it.
#pragma once

#include "cli/cli.h"

namespace cairn::cli {

// Under `bench`.
void AddBenchAdjustmentCommand(CLI::App* bench, Action* action);

}  // namespace cairn::cli

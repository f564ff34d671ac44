// cairn bench follow: what it costs to follow a map of a cairnd.
#pragma once

#include "cli/cli.h"

namespace cairn::cli {

// Under `bench`; the server is that of `app`.
void AddBenchFollowCommand(const CLI::App& app, CLI::App* bench, Action* action);

}  // namespace cairn::cli

// cairn bench server: what its clients get of a cairnd.
#pragma once

#include "cli/cli.h"

namespace cairn::cli {

// Under `bench`; the server is that of `app`.
void AddBenchServerCommand(const CLI::App& app, CLI::App* bench, Action* action);

}  // namespace cairn::cli

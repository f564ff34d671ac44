// cairnd token create|list|revoke: who may do what with which maps.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>

#include "base/status.h"

namespace cairn::server {

// What the command line asked for instead of serving; empty: nothing.
using TokenAction = std::function<absl::Status()>;

// `tokens_file` says which file it is about, from the settings; called when the action runs.
void AddTokenCommand(CLI::App& app, std::function<absl::StatusOr<std::string>()> tokens_file, TokenAction* action);

}  // namespace cairn::server

// cairn --server HOST:PORT: verbs that ask a cairnd instead of a file.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "base/status.h"
#include "client/remote/remote_map_service.h"

namespace cairn::cli {

void AddServerOption(CLI::App& app);

// Empty: no server was named, MAP is a file.
std::string ServerOf(const CLI::App& app);

absl::StatusOr<std::unique_ptr<client::RemoteMapService>> ConnectTo(const std::string& server);

}  // namespace cairn::cli

#include "cli/server_option.h"

namespace cairn::cli {
namespace {

constexpr const char* kOption = "--server";

}  // namespace

void AddServerOption(CLI::App& app) {
  app.add_option(
      kOption,
      "HOST:PORT of a cairnd: ls, info, localize, track, run and bench server ask it, and MAP is a name there");
}

std::string ServerOf(const CLI::App& app) {
  const CLI::Option* option = app.get_option(kOption);
  return option->count() > 0 ? option->as<std::string>() : "";
}

absl::StatusOr<std::unique_ptr<client::RemoteMapService>> ConnectTo(const std::string& server) {
  client::RemoteOptions options;
  options.server = server;
  return client::RemoteMapService::Connect(options);
}

}  // namespace cairn::cli

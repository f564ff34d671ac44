#include "cli/server_option.h"

#include <filesystem>

#include "host/map_host.h"

namespace cairn::cli {
namespace {

constexpr const char* kOption = "--server";

}  // namespace

void AddServerOption(CLI::App& app) {
  app.add_option(kOption,
                 "HOST:PORT of a cairnd: ls, info, log, localize, track, run, align, verify, snapshot, export, delete, "
                 "restore, top "
                 "and bench server ask it, and MAP is a name there");
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

absl::StatusOr<NamedMap> FindMap(const std::string& server, const std::string& path) {
  NamedMap found;
  if (!server.empty()) {
    CAIRN_ASSIGN_OR_RETURN(found.service, ConnectTo(server));
    found.name = path;
    return found;
  }
  const std::filesystem::path file(path);
  if (file.extension() != ".cairn") {
    return absl::InvalidArgumentError(absl::StrCat(path, ": the file of a map is called NAME.cairn"));
  }
  host::MapHostOptions options;
  options.directory = file.has_parent_path() ? file.parent_path().string() : ".";
  CAIRN_ASSIGN_OR_RETURN(found.service, host::MapHost::Open(options));
  found.name = file.stem().string();
  return found;
}

}  // namespace cairn::cli

// cairn ls: the maps of a directory, or of a server.
#include <algorithm>
#include <cstdio>
#include <memory>

#include "cli/cli.h"
#include "cli/described_map.h"
#include "cli/server_option.h"
#include "host/map_host.h"

namespace cairn::cli {
namespace {

struct LsOptions {
  std::string directory;
  std::string server;
  bool json = false;
};

absl::StatusOr<std::unique_ptr<api::MapService>> OpenService(const LsOptions& options) {
  if (!options.server.empty()) return ConnectTo(options.server);
  host::MapHostOptions host;
  host.directory = options.directory;
  return host::MapHost::Open(host);
}

void Print(const std::vector<api::MapSummary>& maps) {
  if (maps.empty()) {
    std::printf("no map\n");
    return;
  }
  std::size_t width = 4;
  for (const api::MapSummary& map : maps) width = std::max(width, map.name.size());
  const int columns = static_cast<int>(width);
  std::printf("%-*s  %9s  %9s  %9s  %8s  %8s\n", columns, "name", "revision", "keyframes", "points", "sessions", "MB");
  for (const api::MapSummary& map : maps) {
    if (!map.status.ok()) {
      std::printf("%-*s  %s\n", columns, map.name.c_str(), std::string(map.status.message()).c_str());
      continue;
    }
    std::printf("%-*s  %9llu  %9lld  %9lld  %8lld  %8.1f%s\n", columns, map.name.c_str(),
                static_cast<unsigned long long>(map.revision), static_cast<long long>(map.keyframes),
                static_cast<long long>(map.points), static_cast<long long>(map.sessions),
                static_cast<double>(map.file_bytes) / 1e6,
                map.writing ? "  being extended"
                : map.open  ? "  open"
                            : "");
  }
}

absl::Status List(const LsOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<api::MapService> service, OpenService(options));
  CAIRN_ASSIGN_OR_RETURN(const std::vector<api::MapSummary> maps, service->List());
  if (!options.json) {
    Print(maps);
    return absl::OkStatus();
  }
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const api::MapSummary& map : maps) json.push_back(SummaryAsJson(map));
  PrintJson({{"maps", json}});
  return absl::OkStatus();
}

}  // namespace

void AddLsCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("ls", "List the maps of a directory or a server");
  auto options = std::make_shared<LsOptions>();
  verb->add_option("DIRECTORY", options->directory, "Where the maps are; with --server its maps are listed");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer("Examples:\n  cairn ls maps/\n  cairn --server localhost:7878 ls");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      if (options->directory.empty() == options->server.empty()) {
        return FailUsage("ls", "name a directory, or give --server HOST:PORT before the verb", options->json);
      }
      const absl::Status status = List(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("ls", status, options->json);
    };
  });
}

}  // namespace cairn::cli

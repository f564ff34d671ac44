// cairn delete, cairn restore: to the trash of a directory of maps, and back.
#include <cstdio>
#include <memory>
#include <vector>

#include "cli/cli.h"
#include "cli/server_option.h"
#include "cli/unix_time.h"
#include "host/map_host.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct DeleteOptions {
  std::string map;
  ServerChoice server;
  bool json = false;
};

absl::Status Delete(const DeleteOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const NamedMap map, FindMap(options.server, options.map));
  CAIRN_ASSIGN_OR_RETURN(const std::string deleted, map.service->Delete(map.name));
  if (options.json) {
    PrintJson({{"map", options.map}, {"deleted", deleted}});
  } else {
    std::printf("%s is in the trash as %s (cairn restore)\n", text::Shown(options.map).c_str(),
                text::Shown(deleted).c_str());
  }
  return absl::OkStatus();
}

struct RestoreOptions {
  std::string deleted;
  std::string as;
  std::string directory;
  ServerChoice server;
  bool list = false;
  bool json = false;
};

absl::StatusOr<std::unique_ptr<api::MapService>> OpenMaps(const RestoreOptions& options) {
  if (!options.server.empty()) return ConnectTo(options.server);
  host::MapHostOptions host;
  host.directory = options.directory;
  return host::MapHost::Open(host);
}

absl::Status ListTrash(const RestoreOptions& options, api::MapService& service) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<api::DeletedMap> maps, service.ListDeleted());
  if (options.json) {
    nlohmann::ordered_json json = nlohmann::ordered_json::array();
    for (const api::DeletedMap& map : maps) {
      json.push_back({{"deleted", map.deleted},
                      {"map", map.map},
                      {"when", FormatUnixTime(map.deleted_unix_ns)},
                      {"bytes", map.file_bytes}});
    }
    PrintJson({{"trash", json}});
    return absl::OkStatus();
  }
  if (maps.empty()) std::printf("the trash is empty\n");
  for (const api::DeletedMap& map : maps) {
    std::printf("%s  %s, deleted %s, %.1f MB\n", text::Shown(map.deleted).c_str(), text::Shown(map.map).c_str(),
                FormatUnixTime(map.deleted_unix_ns).c_str(), static_cast<double>(map.file_bytes) / 1e6);
  }
  return absl::OkStatus();
}

absl::Status Restore(const RestoreOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<api::MapService> maps, OpenMaps(options));
  if (options.list) return ListTrash(options, *maps);
  CAIRN_ASSIGN_OR_RETURN(const std::string name, maps->Restore(options.deleted, options.as));
  if (options.json) {
    PrintJson({{"deleted", options.deleted}, {"map", name}});
  } else {
    std::printf("%s is back as %s\n", text::Shown(options.deleted).c_str(), text::Shown(name).c_str());
  }
  return absl::OkStatus();
}

}  // namespace

void AddDeleteCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("delete", "Move a map to the trash, from where cairn restore brings it back");
  auto options = std::make_shared<DeleteOptions>();
  verb->add_option("MAP", options->map, "Map file (.cairn), with --server the name of a map there")->required();
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "The trash is the folder .trash beside the maps; what lies there takes room until it is removed (rm).\n"
      "Examples:\n"
      "  cairn delete maps/office.cairn\n"
      "  cairn --server localhost:7878 delete office");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      const absl::Status status = Delete(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("delete", status, options->json);
    };
  });
}

void AddRestoreCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("restore", "Bring a map back from the trash");
  auto options = std::make_shared<RestoreOptions>();
  verb->add_option("DELETED", options->deleted, "As cairn delete and --list name it");
  verb->add_flag("--list", options->list, "What is in the trash, and nothing else");
  verb->add_option("--as", options->as, "Name that it gets; by default the one that it had");
  verb->add_option("--directory", options->directory, "Where the maps are, without --server")->default_str(".");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "Examples:\n"
      "  cairn restore --list --directory maps\n"
      "  cairn restore office.1790000000000 --directory maps\n"
      "  cairn --server localhost:7878 restore office.1790000000000 --as office-old");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      if (options->directory.empty()) options->directory = ".";
      if (options->list != options->deleted.empty()) {
        return FailUsage("restore", "name a deleted map, or give --list", options->json);
      }
      const absl::Status status = Restore(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("restore", status, options->json);
    };
  });
}

}  // namespace cairn::cli

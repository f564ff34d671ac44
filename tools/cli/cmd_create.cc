// cairn create: a map in which nothing is yet, for sessions to extend.
#include <cstdio>
#include <memory>

#include "absl/strings/str_format.h"
#include "cli/cli.h"
#include "cli/described_map.h"
#include "cli/server_option.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct NewMapOptions {
  std::string map;
  std::string title;
  ServerChoice server;
  bool json = false;
};

absl::Status MakeMap(const NewMapOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const NamedMap map, FindMap(options.server, options.map));
  CAIRN_ASSIGN_OR_RETURN(const api::MapSummary made, map.service->Create(map.name, options.title));
  if (options.json) {
    PrintJson(SummaryAsJson(made));
  } else {
    text::Say(absl::StrFormat("%s: map \"%s\" of id %s, empty (cairn run --extend)\n", text::Shown(options.map),
                              text::Shown(made.title), made.id));
  }
  return absl::OkStatus();
}

}  // namespace

void AddCreateCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("create", "Make a map in which nothing is yet: sessions extend it");
  auto options = std::make_shared<NewMapOptions>();
  verb->add_option("MAP", options->map, "Map file (.cairn), with --server the name of a map there; must not exist")
      ->required();
  verb->add_option("--title", options->title, "For people; by default its name");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "Examples:\n"
      "  cairn create office.cairn\n"
      "  cairn --server localhost:7878 create office --title \"Office, second floor\"");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      const absl::Status status = MakeMap(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("create", status, options->json);
    };
  });
}

}  // namespace cairn::cli

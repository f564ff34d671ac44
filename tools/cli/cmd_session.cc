// cairn session: what is done to a whole session of a map.
#include <cstdio>
#include <memory>

#include "absl/strings/str_format.h"
#include "care/session_removal.h"
#include "cli/cli.h"
#include "cli/map_to_read.h"
#include "cli/server_option.h"
#include "engine/live_map.h"
#include "health/verify_map.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct RemoveOptions {
  std::string map;
  std::uint32_t session = 0;
  ServerChoice server;
  bool json = false;
};

absl::StatusOr<api::SessionRemoval> RemoveFromFile(const RemoveOptions& options) {
  TellLogDamage("session", options.server, options.map);
  CAIRN_RETURN_IF_ERROR(health::CheckSound(options.map));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<engine::LiveMap> live, engine::LiveMap::Open(options.map));
  CAIRN_ASSIGN_OR_RETURN(const api::SessionRemoval removal,
                         care::RemoveSession(options.map, SessionId(options.session), *live));
  CAIRN_RETURN_IF_ERROR(live->Close());
  return removal;
}

absl::StatusOr<api::SessionRemoval> RemoveIt(const RemoveOptions& options) {
  if (options.server.empty()) return RemoveFromFile(options);
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::RemoteMapService> service, ConnectTo(options.server));
  return service->RemoveSession(options.map, SessionId(options.session));
}

void PrintRemoval(const RemoveOptions& options, const api::SessionRemoval& removal) {
  text::Say(absl::StrFormat("%s: session %u is removed: %s, and %s that nobody else sees\n", text::Shown(options.map),
                            removal.session.value(), text::Keyframes(removal.keyframes), text::Points(removal.points)));
  for (const ComponentId id : removal.removed_components) {
    text::Say(absl::StrFormat("  component %u was its alone, and is gone\n", id.value()));
  }
  if (removal.adjusted_keyframes > 0) {
    text::Say(absl::StrFormat(
        "  %s of others adjusted: %.2f px per axis, as at octave 0; moved by %.2g %% of their depth\n",
        text::Keyframes(removal.adjusted_keyframes), removal.adjustment_rmse_px, 100.0 * removal.median_move_share));
  }
  text::Say(absl::StrFormat("  revision %llu\n", static_cast<unsigned long long>(removal.revision)));
}

void PrintRemovalJson(const RemoveOptions& options, const api::SessionRemoval& removal) {
  nlohmann::ordered_json components = nlohmann::ordered_json::array();
  for (const ComponentId id : removal.removed_components) components.push_back(id.value());
  PrintJson({{"map", options.map},
             {"session", removal.session.value()},
             {"revision", removal.revision},
             {"keyframes_removed", removal.keyframes},
             {"points_removed", removal.points},
             {"components_removed", components},
             {"keyframes_adjusted", removal.adjusted_keyframes},
             {"adjustment_rmse_px", removal.adjustment_rmse_px},
             {"median_move_share", removal.median_move_share}});
}

void AddRemove(CLI::App* session, CLI::App& app, Action* action) {
  CLI::App* verb = session->add_subcommand("remove", "Take a session's keyframes out of a map, and what only it saw");
  auto options = std::make_shared<RemoveOptions>();
  verb->add_option("MAP", options->map, "Map file (.cairn), with --server the name of a map there")->required();
  verb->add_option("ID", options->session, "Its number (cairn ls MAP sessions)")
      ->required()
      ->check(CLI::PositiveNumber);
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "What other sessions saw stays, and is adjusted without it; alignments to the world stay. There is no way back: "
      "take a cairn snapshot before.\n"
      "Examples:\n"
      "  cairn session remove office.cairn 3\n"
      "  cairn --server localhost:7878 session remove office 3");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      const absl::StatusOr<api::SessionRemoval> removal = RemoveIt(*options);
      if (!removal.ok()) return Fail("session remove", removal.status(), options->json);
      if (options->json) {
        PrintRemovalJson(*options, *removal);
      } else {
        PrintRemoval(*options, *removal);
      }
      return static_cast<int>(kOk);
    };
  });
}

}  // namespace

void AddSessionCommand(CLI::App& app, Action* action) {
  CLI::App* session = app.add_subcommand("session", "Take a session out of a map");
  session->require_subcommand(1);
  AddRemove(session, app, action);
  session->footer("See cairn session remove --help.");
}

}  // namespace cairn::cli

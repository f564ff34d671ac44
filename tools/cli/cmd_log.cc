// cairn log: what has changed a map, when, and who did it.
#include <cstdio>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "cli/cli.h"
#include "cli/map_to_read.h"
#include "cli/server_option.h"
#include "cli/unix_time.h"
#include "host/inspect.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct LogOptions {
  std::string map;
  ServerChoice server;
  SessionId::Value session = 0;
  Revision from = 0;
  int count = map::kMaxLoggedChanges;
  bool json = false;
};

std::vector<SessionId::Value> Values(const std::vector<ComponentId>& ids) {
  std::vector<SessionId::Value> values;
  for (const ComponentId id : ids) values.push_back(id.value());
  return values;
}

nlohmann::ordered_json AsJson(const map::LoggedChange& change) {
  nlohmann::ordered_json json = {{"revision", change.revision},
                                 {"committed", FormatUnixTime(change.committed_unix_ns)},
                                 {"committed_unix_ns", change.committed_unix_ns},
                                 {"session", nullptr},
                                 {"reason", change.reason},
                                 {"components", Values(change.components)},
                                 {"keyframes_put", change.keyframes_put},
                                 {"keyframes_removed", change.keyframes_removed},
                                 {"points_put", change.points_put},
                                 {"points_removed", change.points_removed},
                                 {"cameras_put", change.cameras_put},
                                 {"cameras_removed", change.cameras_removed},
                                 {"sessions_put", change.sessions_put},
                                 {"components_put", change.components_put},
                                 {"components_removed", change.components_removed},
                                 {"map_put", change.info_put}};
  if (change.session) json["session"] = change.session.value();
  return json;
}

// "12 keyframes, 310 points; 4 points removed"
std::string Touched(const map::LoggedChange& change) {
  std::vector<std::string> put, removed;
  const auto add = [](std::int64_t count, const char* what, std::vector<std::string>* list) {
    if (count > 0) list->push_back(text::Counted(count, what));
  };
  add(change.keyframes_put, "keyframe", &put);
  add(change.points_put, "point", &put);
  add(change.components_put, "component", &put);
  add(change.cameras_put, "camera", &put);
  add(change.sessions_put, "session", &put);
  if (change.info_put) put.push_back("the map's own data");
  add(change.keyframes_removed, "keyframe", &removed);
  add(change.points_removed, "point", &removed);
  add(change.components_removed, "component", &removed);
  add(change.cameras_removed, "camera", &removed);
  std::string text = absl::StrJoin(put, ", ");
  if (!removed.empty()) absl::StrAppend(&text, text.empty() ? "" : "; ", absl::StrJoin(removed, ", "), " removed");
  if (!change.components.empty()) {
    absl::StrAppend(&text, " (component ", absl::StrJoin(Values(change.components), ", "), ")");
  }
  return text;
}

absl::StatusOr<api::MapLog> ReadLog(const LogOptions& options) {
  map::ChangeQuery query;
  query.from_revision = options.from;
  query.session = SessionId(options.session);
  query.max_count = options.count;
  TellLogDamage("log", options.server, options.map);
  if (options.server.empty()) return host::ReadMapLog(options.map, query);
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::RemoteMapService> service, ConnectTo(options.server));
  return service->Log(options.map, query);
}

absl::Status Log(const LogOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const api::MapLog log, ReadLog(options));
  if (options.json) {
    nlohmann::ordered_json json = nlohmann::ordered_json::array();
    for (const map::LoggedChange& change : log.changes) json.push_back(AsJson(change));
    PrintJson({{"map", options.map}, {"revision", log.revision}, {"changes", json}});
    return absl::OkStatus();
  }
  for (const map::LoggedChange& change : log.changes) {
    const std::string when = FormatUnixTime(change.committed_unix_ns);
    text::Say(absl::StrFormat("%6llu  %-23s  %-9s  %s\n        %s\n", change.revision, when.empty() ? "-" : when,
                              change.session ? absl::StrCat("session ", change.session.value()) : "-",
                              text::Shown(change.reason), Touched(change)));
  }
  if (log.changes.empty()) std::printf("no change of the map fits (the newest %d are kept)\n", map::kMaxLoggedChanges);
  return absl::OkStatus();
}

}  // namespace

void AddLogCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("log", "What has changed a map, when, by which session; the newest first");
  auto options = std::make_shared<LogOptions>();
  verb->add_option("MAP", options->map, "Map file (.cairn), with --server the name of a map there")->required();
  verb->add_option("--session", options->session, "Only the changes that this session made");
  verb->add_option("--from", options->from, "Only those that led to this revision, and later ones");
  verb->add_option("--count", options->count, "At most so many")
      ->check(CLI::Range(1, map::kMaxLoggedChanges))
      ->capture_default_str();
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(absl::StrCat("The newest ", map::kMaxLoggedChanges,
                            " changes of a map are kept.\n"
                            "Examples:\n"
                            "  cairn log office.cairn\n"
                            "  cairn log office.cairn --session 2 --from 120\n"
                            "  cairn --server localhost:7878 log office --count 20"));
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      const absl::Status status = Log(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("log", status, options->json);
    };
  });
}

}  // namespace cairn::cli

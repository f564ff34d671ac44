// cairn ls: the maps of a directory or of a server, and what is in one of them.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>

#include "absl/strings/match.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "api/map_service.h"
#include "cli/cli.h"
#include "cli/described_map.h"
#include "cli/loaded_map.h"
#include "cli/map_to_read.h"
#include "cli/server_option.h"
#include "host/map_host.h"
#include "inspect/listing.h"
#include "store/map_store.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct LsOptions {
  std::string path;
  std::string what;
  std::string sort;
  inspect::ListingQuery query;
  ServerChoice server;
  bool json = false;
};

const std::map<std::string, inspect::Kind> kKinds = {{"keyframes", inspect::Kind::kKeyframes},
                                                     {"points", inspect::Kind::kPoints},
                                                     {"sessions", inspect::Kind::kSessions},
                                                     {"components", inspect::Kind::kComponents},
                                                     {"cameras", inspect::Kind::kCameras}};

absl::StatusOr<std::unique_ptr<api::MapService>> OpenService(const LsOptions& options) {
  if (!options.server.empty()) return ConnectTo(options.server);
  host::MapHostOptions host;
  host.directory = options.path;
  return host::MapHost::Open(host);
}

nlohmann::ordered_json CellAsJson(const inspect::Cell& cell) {
  switch (cell.kind) {
    case inspect::Cell::Kind::kNothing:
      return nullptr;
    case inspect::Cell::Kind::kWhole:
      return cell.whole;
    case inspect::Cell::Kind::kReal:
      return cell.real;
    case inspect::Cell::Kind::kFlag:
      return cell.whole != 0;
    case inspect::Cell::Kind::kText:
      return cell.text;
  }
  return nullptr;
}

nlohmann::ordered_json RowsAsJson(const inspect::Listing& listing) {
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  for (const auto& row : listing.rows) {
    nlohmann::ordered_json& json = rows.emplace_back(nlohmann::ordered_json::object());
    for (std::size_t i = 0; i < row.size(); ++i) json[listing.columns[i].name] = CellAsJson(row[i]);
  }
  return rows;
}

void PrintListing(const inspect::Listing& listing) {
  std::vector<text::TextColumn> columns;
  for (const inspect::Column& column : listing.columns) {
    columns.push_back({column.brief.empty() ? column.name : column.brief, column.text});
  }
  std::vector<std::vector<std::string>> rows;
  for (const auto& row : listing.rows) {
    std::vector<std::string>& cells = rows.emplace_back();
    for (std::size_t i = 0; i < row.size(); ++i) {
      const std::string text = inspect::CellText(listing.columns[i], row[i]);
      cells.push_back(text.empty() ? "-" : text);
    }
  }
  std::fputs(text::TextTable(columns, rows).c_str(), stdout);
  if (listing.rows.size() < listing.total) {
    std::printf("%zu of %zu (--limit)\n", listing.rows.size(), listing.total);
  }
}

std::string StateOf(const api::MapSummary& map) {
  if (!map.status.ok()) return std::string(map.status.message());
  return map.writing ? "being extended" : map.open ? "open" : "";
}

inspect::Listing ListingOf(const std::vector<api::MapSummary>& maps) {
  inspect::Listing listing;
  const auto column = [](const char* name, bool text = false, int decimals = 0) {
    return inspect::Column{name, text, decimals, ""};
  };
  listing.columns = {column("name", true), column("revision"),     column("keyframes"),  column("points"),
                     column("sessions"),   column("MB", false, 1), column("state", true)};
  for (const api::MapSummary& map : maps) {
    if (!map.status.ok()) {
      listing.rows.push_back({map.name, {}, {}, {}, {}, {}, StateOf(map)});
      continue;
    }
    listing.rows.push_back({map.name, static_cast<std::int64_t>(map.revision), map.keyframes, map.points, map.sessions,
                            static_cast<double>(map.file_bytes) / 1e6, StateOf(map)});
  }
  return listing;
}

// Maps in a folder that a server could not name.
std::vector<std::string> WithoutName(const std::string& folder) {
  std::vector<std::string> files;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder.empty() ? "." : folder, error)) {
    const std::string file = entry.path().filename().string();
    absl::string_view name = file;
    if (!absl::StartsWith(file, ".") && absl::ConsumeSuffix(&name, ".cairn") &&
        !api::CheckMapName(std::string(name)).ok()) {
      files.push_back(file);
    }
  }
  std::ranges::sort(files);
  return files;
}

absl::Status ListMaps(const LsOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<api::MapService> service, OpenService(options));
  CAIRN_ASSIGN_OR_RETURN(const std::vector<api::MapSummary> maps, service->List());
  const std::vector<std::string> unnamed =
      options.server.empty() ? WithoutName(options.path) : std::vector<std::string>();
  inspect::Listing listing = ListingOf(maps);
  inspect::ListingQuery query = options.query;
  query.sort = options.sort.empty() ? "name" : options.sort;
  CAIRN_RETURN_IF_ERROR(inspect::Arrange(query, &listing));
  if (!options.json) {
    if (maps.empty()) {
      std::printf("no map\n");
    } else {
      PrintListing(listing);
    }
    // The table cuts them.
    for (const api::MapSummary& map : maps) {
      if (!map.status.ok()) text::Say(absl::StrCat(text::Shown(map.name), ": ", text::Shown(StateOf(map)), "\n"));
    }
    for (const std::string& file : unnamed) {
      text::Say(absl::StrCat(text::Shown(file),
                             ": not listed, as no map of a server can have this name (letters, "
                             "digits, ., - and _)\n"));
    }
    return absl::OkStatus();
  }
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const auto& row : listing.rows) {
    const auto map = std::ranges::find(maps, row[0].text, &api::MapSummary::name);
    json.push_back(SummaryAsJson(*map));
  }
  PrintJson({{"maps", json}, {"total", listing.total}, {"files_not_listed", unnamed}});
  return absl::OkStatus();
}

absl::Status ListContent(const LsOptions& options) {
  const inspect::Kind kind = kKinds.at(options.what.empty() ? "keyframes" : options.what);
  inspect::ListingQuery query = options.query;
  query.sort = options.sort.empty() ? "id" : options.sort;
  inspect::Listing none{inspect::ColumnsOf(kind), {}, 0};
  CAIRN_RETURN_IF_ERROR(inspect::Arrange(query, &none));  // a wrong name is told before a large map is loaded
  TellLogDamage("ls", options.server, options.path);
  CAIRN_ASSIGN_OR_RETURN(const MapToRead source, MapToRead::Open(options.server, options.path));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> file,
                         store::OpenMapStore(source.path(), store::OpenMode::kRead));
  inspect::Listing listing;
  Revision revision = 0;
  CAIRN_RETURN_IF_ERROR(
      LookInto(*file, inspect::LooksAtFew(kind, query), [&](const map::Snapshot& map) -> absl::Status {
        revision = map.revision();
        CAIRN_ASSIGN_OR_RETURN(listing, inspect::List(map, kind, query));
        return absl::OkStatus();
      }));
  if (options.json) {
    PrintJson({{"map", options.path},
               {"revision", revision},
               {options.what.empty() ? "keyframes" : options.what, RowsAsJson(listing)},
               {"total", listing.total}});
  } else {
    PrintListing(listing);
  }
  return absl::OkStatus();
}

int List(const LsOptions& options) {
  std::error_code error;
  const bool of_map =
      !options.what.empty() ||
      (!options.path.empty() && (!options.server.empty() || !std::filesystem::is_directory(options.path, error)));
  if (options.path.empty() && options.server.empty()) {
    return FailUsage("ls", "name a directory or a map, or give --server HOST:PORT before the verb", options.json);
  }
  const absl::Status status = of_map ? ListContent(options) : ListMaps(options);
  if (absl::IsInvalidArgument(status) && store::FaultOf(status) == store::Fault::kNone) {
    return FailUsage("ls", std::string(status.message()), options.json);
  }
  return status.ok() ? static_cast<int>(kOk) : Fail("ls", status, options.json);
}

}  // namespace

void AddLsCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("ls", "List the maps of a directory or a server, or what is in a map");
  auto options = std::make_shared<LsOptions>();
  verb->add_option("PATH", options->path,
                   "Directory of maps, or a map file (.cairn); with --server nothing, or the name of a map there");
  verb->add_option("WHAT", options->what, "Of a map: keyframes (default), points, sessions, components or cameras")
      ->check(CLI::IsMember({"keyframes", "points", "sessions", "components", "cameras"}));
  verb->add_option("--sort", options->sort, "By this column, or a start of its name; what is not known comes last")
      ->type_name("COLUMN");
  verb->add_flag("--reverse", options->query.descending, "The largest first");
  verb->add_option("--filter", options->query.filters,
                   "Only rows with COLUMN=VALUE, or !=, <, <=, >, >=, ~ (contains); may be given several times")
      ->allow_extra_args(false);
  verb->add_option("--limit", options->query.limit, "At most so many rows; 0: all")->capture_default_str();
  verb->add_flag("--json", options->json, "Answer in JSON");
  std::string columns;
  for (const auto& [name, kind] : kKinds) {
    absl::StrAppend(&columns, "Columns of ", name, ": ",
                    absl::StrJoin(inspect::ColumnsOf(kind), ", ",
                                  [](std::string* out, const inspect::Column& c) { out->append(c.name); }),
                    ".\n");
  }
  verb->footer(
      columns +
      "Positions x, y, z and lengths are metres in the world where the component is aligned, else map units.\n"
      "error_px: reprojection error, root of the mean square. depth: of keyframes the median of their points,\n"
      "of points the distance from their reference keyframe. found: how often, of the times it was expected.\n"
      "Exit codes: 0 ok, 1 failure, 2 usage, 3 map damaged, 5 version.\n"
      "Examples:\n"
      "  cairn ls maps/\n"
      "  cairn ls office.cairn keyframes --sort points --limit 10\n"
      "  cairn ls office.cairn points --filter component=1 --filter 'error_px>2' --sort error_px --reverse\n"
      "  cairn --server localhost:7878 ls\n"
      "  cairn --server localhost:7878 ls office sessions");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] { return List(*options); };
  });
}

}  // namespace cairn::cli

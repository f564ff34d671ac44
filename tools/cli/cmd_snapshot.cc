// cairn snapshot: a copy of a map as it is now, while others may go on writing it.
#include <cstdio>
#include <memory>

#include "absl/strings/str_format.h"
#include "cli/cli.h"
#include "cli/described_map.h"
#include "cli/input_options.h"
#include "cli/server_option.h"
#include "host/describe.h"
#include "store/map_store.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct SnapshotOptions {
  std::string map;
  std::string copy;
  ServerChoice server;
  bool unchecked = false;
  bool json = false;
};

absl::StatusOr<api::MapSummary> CopyFile(const std::string& map, const std::string& copy, bool unchecked) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> from, store::OpenMapStore(map, store::OpenMode::kRead));
  TellNotes("snapshot", from->notes());
  CAIRN_RETURN_IF_ERROR(unchecked ? from->CopyTo(copy) : from->CopySound(copy));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> made,
                         store::OpenMapStore(copy, store::OpenMode::kRead));
  CAIRN_ASSIGN_OR_RETURN(const store::MapSummary summary, made->ReadSummary());
  return host::SummaryOf(copy, summary);
}

absl::StatusOr<api::MapSummary> Copy(const SnapshotOptions& options) {
  if (options.server.empty()) return CopyFile(options.map, options.copy, options.unchecked);
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::RemoteMapService> service, ConnectTo(options.server));
  return service->Snapshot(options.map, options.copy);
}

absl::Status TakeSnapshot(const SnapshotOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const api::MapSummary copy, Copy(options));
  if (options.json) {
    PrintJson(SummaryAsJson(copy));
  } else {
    text::Say(absl::StrFormat("%s is a copy of %s at revision %llu: %s, %s, %.1f MB\n", text::Shown(copy.name),
                              text::Shown(options.map), static_cast<unsigned long long>(copy.revision),
                              text::Keyframes(copy.keyframes), text::Points(copy.points),
                              static_cast<double>(copy.file_bytes) / 1e6));
  }
  return absl::OkStatus();
}

}  // namespace

void AddSnapshotCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("snapshot", "Copy a map as it is now, also while sessions are writing it");
  auto options = std::make_shared<SnapshotOptions>();
  verb->add_option("MAP", options->map, "Map file (.cairn), with --server the name of a map there")->required();
  verb->add_option("COPY", options->copy, "File of the copy, with --server its name there; must not exist")->required();
  verb->add_flag("--unchecked", options->unchecked, "Do not look whether the copy is good: damage is copied, too");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "The copy is checked as cairn verify does; of a damaged map none is made (exit code 3).\n"
      "Examples:\n"
      "  cairn snapshot office.cairn office-before.cairn\n"
      "  cairn --server localhost:7878 snapshot office office-before");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    if (options->unchecked && !options->server.empty()) throw CLI::ExcludesError("--unchecked", "--server");
    *action = [=] {
      const absl::Status status = TakeSnapshot(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("snapshot", status, options->json);
    };
  });
}

}  // namespace cairn::cli

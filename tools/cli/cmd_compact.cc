// cairn compact: gives back the room that what was removed from a map left in its file.
#include <cstdio>
#include <filesystem>
#include <memory>

#include "absl/strings/str_format.h"
#include "cli/cli.h"
#include "cli/input_options.h"
#include "store/map_store.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct CompactOptions {
  std::string map;
  bool json = false;
};

struct Compacted {
  std::int64_t before = 0, after = 0;
};

// What does not fit its checksum would be written anew as it is: of the file as it was more can still be saved. By a
// connection that only reads, as who opens a map to write brings it up to date.
absl::Status RequireSound(const std::string& map) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> store,
                         store::OpenMapStore(map, store::OpenMode::kRead));
  CAIRN_ASSIGN_OR_RETURN(const std::vector<store::Finding> findings, store->Verify());
  return Annotate(store::StatusOf(findings), absl::StrCat(map, " is not compacted"));
}

absl::StatusOr<Compacted> CompactFile(const CompactOptions& options) {
  CAIRN_RETURN_IF_ERROR(RequireSound(options.map));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> store,
                         store::OpenMapStore(options.map, store::OpenMode::kWrite));
  TellNotes("compact", store->notes());
  Compacted compacted;
  CAIRN_ASSIGN_OR_RETURN(const store::MapSummary before, store->ReadSummary());
  compacted.before = before.file_bytes;
  CAIRN_RETURN_IF_ERROR(store->Compact());
  CAIRN_ASSIGN_OR_RETURN(const store::MapSummary after, store->ReadSummary());
  compacted.after = after.file_bytes;
  CAIRN_RETURN_IF_ERROR(store->Close());
  return compacted;
}

}  // namespace

void AddCompactCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("compact", "Give back the room that what was removed left in a map's file");
  auto options = std::make_shared<CompactOptions>();
  verb->add_option("MAP", options->map, "Map file (.cairn)")->required();
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "The content stays as it is (same digest). It needs as much free disk as the map has bytes; killed on the way it "
      "leaves the map as it was. Others may read meanwhile. A damaged map is left as it is (exit code 3).\n"
      "Examples:\n"
      "  cairn compact office.cairn\n"
      "  cairn prune office.cairn && cairn compact office.cairn");
  verb->callback([=] {
    *action = [=] {
      const absl::StatusOr<Compacted> compacted = CompactFile(*options);
      if (!compacted.ok()) return Fail("compact", compacted.status(), options->json);
      if (options->json) {
        PrintJson({{"map", options->map}, {"bytes_before", compacted->before}, {"bytes_after", compacted->after}});
      } else {
        text::Say(absl::StrFormat("%s: %.2f MB, was %.2f MB\n", text::Shown(options->map),
                                  static_cast<double>(compacted->after) / 1e6,
                                  static_cast<double>(compacted->before) / 1e6));
      }
      return static_cast<int>(kOk);
    };
  });
}

}  // namespace cairn::cli

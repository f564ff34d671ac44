// cairn export: files made from a map, for other programs.
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>

#include "cli/cli.h"
#include "cli/export_served.h"
#include "cli/server_option.h"
#include "host/export.h"

namespace cairn::cli {
namespace {

struct ExportOptions {
  std::string map;
  std::string out;
  ServerChoice server;
  bool overwrite = false;
  bool json = false;
};

absl::Status Write(const ExportOptions& options, api::ExportContent content) {
  if (!options.server.empty()) return ExportServed(options.server, options.map, content, options.out);
  std::error_code error;
  if (options.overwrite) std::filesystem::remove(options.out, error);
  return host::ExportMap(options.map, content, options.out);
}

absl::Status Export(const ExportOptions& options, api::ExportContent content) {
  CAIRN_RETURN_IF_ERROR(CheckWritable(options.out, options.overwrite));
  CAIRN_RETURN_IF_ERROR(CheckDistinct({options.out}, {options.server.empty() ? options.map : std::string()}));
  CAIRN_RETURN_IF_ERROR(Write(options, content));
  std::error_code error;
  const auto bytes = std::filesystem::file_size(options.out, error);
  if (options.json) {
    PrintJson({{"map", options.map}, {"file", options.out}, {"bytes", error ? 0 : bytes}});
  } else {
    std::printf("%s: %.1f MB\n", options.out.c_str(), error ? 0.0 : static_cast<double>(bytes) / 1e6);
  }
  return absl::OkStatus();
}

}  // namespace

void AddExportCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("export", "Make a file from a map for other programs");
  auto options = std::make_shared<ExportOptions>();
  verb->add_option("MAP", options->map, "Map file (.cairn), with --server the name of a map there")->required();
  verb->add_option("FILE", options->out,
                   "What to make: .cairn the map itself, .txt or .tum the poses of its keyframes, .ply its points")
      ->required();
  verb->add_flag("--overwrite", options->overwrite, "Replace the file if it exists");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "Poses and points are in the world frame, in metres, once the map is aligned (cairn align).\n"
      "Examples:\n"
      "  cairn export office.cairn office.ply\n"
      "  cairn --server localhost:7878 export office office.cairn");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      const std::optional<api::ExportContent> content = ContentOfFile(options->out);
      if (!content) return FailUsage("export", "FILE ends with .cairn, .txt, .tum or .ply", options->json);
      const absl::Status status = Export(*options, *content);
      return status.ok() ? static_cast<int>(kOk) : Fail("export", status, options->json);
    };
  });
}

}  // namespace cairn::cli

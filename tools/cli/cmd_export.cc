// cairn export: files made from a map, for other programs.
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "cli/cli.h"
#include "cli/export_model.h"
#include "cli/export_served.h"
#include "cli/map_to_read.h"
#include "cli/server_option.h"
#include "host/export.h"
#include "store/map_store.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct ExportOptions {
  std::string map;
  std::string out;
  ServerChoice server;
  bool overwrite = false;
  bool json = false;
};

void RemoveQuietly(const std::string& map) {
  std::error_code ignored;
  for (const char* suffix : {"", "-wal", "-shm", "-lock"}) std::filesystem::remove(map + suffix, ignored);
}

// The map itself, of which what is damaged is not copied without a word. A file that is there goes for a good one only.
absl::Status WriteMap(const ExportOptions& options) {
  if (options.server.empty()) {
    CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> map,
                           store::OpenMapStore(options.map, store::OpenMode::kRead));
    return map->CopySound(options.out);
  }
  const std::string fetched = absl::StrCat(options.out, ".fetched");
  CAIRN_RETURN_IF_ERROR(ExportServed(options.server, options.map, api::ExportContent::kMap, fetched));
  const absl::Status sound = [&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> map,
                           store::OpenMapStore(fetched, store::OpenMode::kRead));
    CAIRN_ASSIGN_OR_RETURN(const std::vector<store::Finding> findings, map->Verify());
    return Annotate(store::StatusOf(findings), "nothing is exported");
  }();
  if (!sound.ok()) RemoveQuietly(fetched);
  CAIRN_RETURN_IF_ERROR(sound);
  std::error_code error;
  std::filesystem::rename(fetched, options.out, error);
  return error ? absl::InternalError(absl::StrCat(options.out, ": ", error.message())) : absl::OkStatus();
}

absl::Status Write(const ExportOptions& options, api::ExportContent content) {
  if (content == api::ExportContent::kMap) return WriteMap(options);
  if (!options.server.empty()) return ExportServed(options.server, options.map, content, options.out);
  std::error_code error;
  if (!std::filesystem::exists(options.out, error)) {
    return host::ExportMap(options.map, content, options.out);
  }
  const std::string part = absl::StrCat(options.out, ".part");
  std::filesystem::remove(part, error);
  CAIRN_RETURN_IF_ERROR(host::ExportMap(options.map, content, part));
  std::filesystem::rename(part, options.out, error);
  if (!error) return absl::OkStatus();
  const std::string why = error.message();
  std::filesystem::remove(part, error);
  return absl::InternalError(absl::StrCat(options.out, ": ", why));
}

// What a file holds, as it says itself.
struct Exported {
  std::optional<std::int64_t> keyframes, points;
  std::optional<bool> in_world;  // not known of a file of an older server
  std::string without;           // "without 9 keyframes of 2 components in other frames"; empty: nothing
};

// As host/export.cc writes it at the head of a file.
constexpr char kSeparator[] = ", ", kWithout[] = ", without ", kFrame[] = ", frame";

absl::StatusOr<Exported> ReadBack(const std::string& path, api::ExportContent content) {
  Exported exported;
  if (content == api::ExportContent::kMap) {
    CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> map,
                           store::OpenMapStore(path, store::OpenMode::kRead));
    CAIRN_ASSIGN_OR_RETURN(const store::MapSummary summary, map->ReadSummary());
    exported.keyframes = summary.keyframes;
    exported.points = summary.points;
    return exported;
  }
  std::ifstream file(path, std::ios::binary);
  std::int64_t poses = 0;
  for (std::string line; std::getline(file, line) && line != "end_header";) {
    const bool comment = absl::StartsWith(line, "#") || absl::StartsWith(line, "comment ");
    if (comment && absl::EndsWith(line, ", frame world, metres")) exported.in_world = true;
    if (comment && absl::EndsWith(line, ", map units")) exported.in_world = false;
    if (const std::size_t begin = line.rfind(kWithout); comment && begin != std::string::npos) {
      const std::size_t from = begin + sizeof(kSeparator) - 1;
      exported.without = line.substr(from, line.find(kFrame, from) - from);
    }
    std::int64_t vertices = 0;
    absl::string_view count = line;
    if (absl::ConsumePrefix(&count, "element vertex ") && absl::SimpleAtoi(count, &vertices)) {
      exported.points = vertices;
    }
    poses += comment || line.empty() ? 0 : 1;
  }
  if (content == api::ExportContent::kTrajectory) exported.keyframes = poses;
  return exported;
}

std::string Describe(const Exported& exported, api::ExportContent content) {
  std::string text;
  if (exported.keyframes) {
    absl::StrAppend(&text, content == api::ExportContent::kTrajectory ? "poses of " : "", *exported.keyframes,
                    " keyframes");
  }
  if (exported.points) absl::StrAppend(&text, exported.keyframes ? " and " : "", *exported.points, " points");
  if (exported.in_world) absl::StrAppend(&text, ", in ", *exported.in_world ? "the world, metres" : "map units");
  return text;
}

absl::Status Export(const ExportOptions& options, api::ExportContent content) {
  CAIRN_RETURN_IF_ERROR(CheckWritable(options.out, options.overwrite));
  CAIRN_RETURN_IF_ERROR(CheckDistinct({options.out}, {options.server.empty() ? options.map : std::string()}));
  CAIRN_RETURN_IF_ERROR(Write(options, content));
  std::error_code error;
  const auto bytes = std::filesystem::file_size(options.out, error);
  CAIRN_ASSIGN_OR_RETURN(const Exported exported, ReadBack(options.out, content));
  if (options.json) {
    nlohmann::ordered_json json = {{"map", options.map}, {"file", options.out}, {"bytes", error ? 0 : bytes}};
    if (exported.in_world) AddFrameAndUnit(*exported.in_world, &json);
    if (!exported.without.empty()) json["left_out"] = exported.without;
    if (exported.keyframes) json["keyframes"] = *exported.keyframes;
    if (exported.points) json["points"] = *exported.points;
    PrintJson(json);
  } else {
    const std::string told = absl::StrFormat("%s: %s, %.1f MB", text::Shown(options.out), Describe(exported, content),
                                             error ? 0.0 : static_cast<double>(bytes) / 1e6);
    std::fputs(text::WrappedOn(stdout, told).c_str(), stdout);
    if (!exported.without.empty()) std::printf("  %s\n", exported.without.c_str());
  }
  return absl::OkStatus();
}

// What a server can make, too, is made in the same way here; everything else is a model of another program.
bool IsModel(const ModelExport& model) {
  return !model.format.empty() || !model.images.empty() || model.component != 0 || !ContentOfFile(model.out);
}

int ExportFile(const ExportOptions& options, ModelExport model) {
  model.map = options.map;
  model.server = options.server;
  model.out = options.out;
  model.overwrite = options.overwrite;
  model.json = options.json;
  const bool is_model = IsModel(model);
  if (is_model && model.format.empty()) model.format = FormatOfName(model.out);
  if (is_model && model.format.empty()) {
    return FailUsage("export",
                     absl::StrCat("the ending of OUT is not known (.cairn, .txt, .tum, .ply, .csv, .g2o, .json): say "
                                  "--format ",
                                  absl::StrJoin(ModelFormats(), "|")),
                     options.json);
  }
  TellLogDamage("export", options.server, options.map);
  const absl::Status status = is_model ? ExportModel(model) : Export(options, *ContentOfFile(options.out));
  return status.ok() ? static_cast<int>(kOk) : Fail("export", status, options.json);
}

}  // namespace

void AddExportCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("export", "Make files from a map for other programs");
  auto options = std::make_shared<ExportOptions>();
  auto model = std::make_shared<ModelExport>();
  verb->add_option("MAP", options->map, "Map file (.cairn), with --server the name of a map there")->required();
  verb->add_option(
          "OUT", options->out,
          "What to make: .cairn the map itself, .txt or .tum the poses of its keyframes, .ply its points, .csv, "
          ".g2o, .json; a folder for colmap and nerfstudio")
      ->required();
  verb->add_option("--format", model->format, "If the name of OUT does not tell it")
      ->check(CLI::IsMember(ModelFormats()));
  verb->add_option(
      "--images", model->images,
      "The sequence that was mapped: gray values for points and, where OUT is a folder, undistorted images "
      "of its keyframes in OUT/images");
  verb->add_option("--camera", model->camera, "Calibration of that sequence, if it has none of its own");
  verb->add_option("--component", model->component, "Only this one; else all that are aligned, or the largest")
      ->check(CLI::PositiveNumber);
  verb->add_flag("--overwrite", options->overwrite, "Replace files that exist");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "Poses and points are in the world frame, in metres, once the map is aligned (cairn align).\n"
      "colmap, colmap-text: cameras, images, points3D; pixel centres at halves, as COLMAP has them.\n"
      "nerfstudio: transforms.json. tum, kitti (and times.txt), euroc: poses of the cameras of the keyframes.\n"
      "g2o: keyframes and what links them. ply: points. json: all of it.\n"
      "Exit codes: 0 ok, 1 failure, 2 usage, 3 map damaged, 5 version.\n"
      "Examples:\n"
      "  cairn export office.cairn office.ply\n"
      "  cairn export office.cairn model --format colmap --images office\n"
      "  cairn --server localhost:7878 export office office.cairn\n"
      "  cairn --server localhost:7878 export office model --format colmap");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] { return ExportFile(*options, *model); };
  });
}

}  // namespace cairn::cli

// cairn pack: a map as small as one that is only asked where a camera is can be.
#include <cstdio>
#include <filesystem>
#include <memory>

#include "absl/strings/str_format.h"
#include "care/packing.h"
#include "care/self_queries.h"
#include "care/whole_map.h"
#include "cli/cli.h"
#include "cli/loaded_map.h"
#include "cli/self_query_report.h"
#include "store/map_store.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct PackCommand {
  std::string map, out;
  care::PackOptions options;
  bool localization_only = false;
  int tests = 100;
  bool overwrite = false;
  bool json = false;
};

struct PackReport {
  care::Packed packed;
  std::int64_t keyframes = 0, points_before = 0;
  std::int64_t bytes_before = 0, bytes_after = 0, vocabulary_bytes = 0;
  std::optional<care::SelfQueries> queries;

  // Of what belongs to keyframes: without the vocabulary.
  double BytesPerKeyframe() const {
    return keyframes > 0 ? static_cast<double>(bytes_after - vocabulary_bytes) / static_cast<double>(keyframes) : 0.0;
  }
  double FeaturesPerKeyframe() const {
    return keyframes > 0 ? static_cast<double>(packed.features_before) / static_cast<double>(keyframes) : 0.0;
  }
};

absl::StatusOr<std::int64_t> MapFileBytes(const std::string& path, std::int64_t* vocabulary) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> store,
                         store::OpenMapStore(path, store::OpenMode::kRead));
  CAIRN_ASSIGN_OR_RETURN(const store::MapSummary summary, store->ReadSummary());
  *vocabulary = summary.vocabulary_bytes;
  return summary.file_bytes;
}

absl::StatusOr<PackReport> RunPack(const PackCommand& command) {
  CAIRN_RETURN_IF_ERROR(CheckDistinct({command.out}, {command.map}));
  CAIRN_RETURN_IF_ERROR(CheckWritable(command.out, command.overwrite, /*is_map=*/true));
  CAIRN_ASSIGN_OR_RETURN(const LoadedMap loaded, LoadMap("pack", command.map));
  CAIRN_RETURN_IF_ERROR(RequireKeyframes(command.map, *loaded.map));
  const map::MapInfo info = care::NewMapInfo(loaded.map->info(), loaded.map->info().name);
  PackReport report;
  CAIRN_ASSIGN_OR_RETURN(report.packed, care::Pack(*loaded.map, info, command.options));
  report.keyframes = static_cast<std::int64_t>(loaded.map->keyframes().size());
  report.points_before = static_cast<std::int64_t>(loaded.map->points().size());
  if (command.tests > 0 && loaded.words != nullptr && report.keyframes > 0) {
    CAIRN_ASSIGN_OR_RETURN(const auto before, loaded.View());
    CAIRN_ASSIGN_OR_RETURN(const auto after, tracking::MapView::Create(report.packed.map, loaded.words));
    inspect::CoverageOptions coverage;
    coverage.max_tests = command.tests;
    Progress progress("pack", std::min<std::int64_t>(command.tests, report.keyframes), command.json);
    CAIRN_ASSIGN_OR_RETURN(report.queries, care::CompareSelfQueries(*before, *after, coverage, [&](int done, int) {
                             progress.Update(done);
                             return true;
                           }));
  }
  // What can be made again is no part of a map that is to be small.
  store::WriteOptions write;
  write.ready = false;
  CAIRN_RETURN_IF_ERROR(care::WriteNewMap(*report.packed.map, info, loaded.Vocabulary(), command.out, command.overwrite,
                                          "pack for localization only", write));
  CAIRN_ASSIGN_OR_RETURN(report.bytes_before, MapFileBytes(command.map, &report.vocabulary_bytes));
  CAIRN_ASSIGN_OR_RETURN(report.bytes_after, MapFileBytes(command.out, &report.vocabulary_bytes));
  return report;
}

void PrintPack(const PackCommand& command, const PackReport& report) {
  text::Say(absl::StrFormat("%s: %.1f MB, was %.1f MB (of both the vocabulary takes %.1f MB)\n",
                            text::Shown(command.out), static_cast<double>(report.bytes_after) / 1e6,
                            static_cast<double>(report.bytes_before) / 1e6,
                            static_cast<double>(report.vocabulary_bytes) / 1e6));
  text::Say(absl::StrFormat(
      "  %lld of %lld features are kept, %zu of %lld points\n  %.1f kB per keyframe (%.1f per 1000 features)\n",
      static_cast<long long>(report.packed.features_after), static_cast<long long>(report.packed.features_before),
      report.packed.map->points().size(), static_cast<long long>(report.points_before), report.BytesPerKeyframe() / 1e3,
      report.FeaturesPerKeyframe() > 0.0 ? report.BytesPerKeyframe() / report.FeaturesPerKeyframe() : 0.0));
  if (!report.queries) return;
  PrintSelfQueries(*report.queries);
}

void PrintPackJson(const PackCommand& command, const PackReport& report) {
  nlohmann::ordered_json json = {{"map", command.map},
                                 {"packed", command.out},
                                 {"bytes_before", report.bytes_before},
                                 {"bytes_after", report.bytes_after},
                                 {"vocabulary_bytes", report.vocabulary_bytes},
                                 {"keyframes", report.keyframes},
                                 {"features_before", report.packed.features_before},
                                 {"features_after", report.packed.features_after},
                                 {"points_before", report.points_before},
                                 {"points_after", report.packed.map->points().size()},
                                 {"bytes_per_keyframe", report.BytesPerKeyframe()}};
  if (report.FeaturesPerKeyframe() > 0.0) {
    json["bytes_per_keyframe_and_1000_features"] = 1000.0 * report.BytesPerKeyframe() / report.FeaturesPerKeyframe();
  }
  if (report.queries) json.update(SelfQueriesAsJson(*report.queries));
  PrintJson(json);
}

}  // namespace

void AddPackCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("pack", "A copy of a map with only what it takes to be found in it");
  auto command = std::make_shared<PackCommand>();
  verb->add_option("MAP", command->map, "Map file (.cairn); it is only read")->required();
  verb->add_option("-o,--out", command->out, "File of the packed map")->required();
  verb->add_flag("--localization-only", command->localization_only,
                 "Leave out what localizing does not need: features without a point, sightings of points that look the "
                 "same, history. For now there is no other way to pack")
      ->required();
  verb->add_option("--sightings", command->options.max_sightings, "Of a point, at most, in keyframes that see many")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  verb->add_option("--tests", command->tests, "Keyframes that are looked for in both, to say what it costs; 0: none")
      ->capture_default_str()
      ->check(CLI::NonNegativeNumber);
  verb->add_flag("--overwrite", command->overwrite, "Replace a map that is there");
  verb->add_flag("--json", command->json, "Answer in JSON");
  verb->footer(
      "Sessions can extend a packed map, but have less to hold on to there: keep the whole one for that.\n"
      "Examples:\n"
      "  cairn pack office.cairn --localization-only -o office-small.cairn\n"
      "  cairn pack office.cairn --localization-only -o phone.cairn --tests 0 --json");
  verb->callback([=] {
    *action = [=] {
      const absl::StatusOr<PackReport> report = RunPack(*command);
      if (!report.ok()) return Fail("pack", report.status(), command->json);
      command->json ? PrintPackJson(*command, *report) : PrintPack(*command, *report);
      return static_cast<int>(kOk);
    };
  });
}

}  // namespace cairn::cli

// cairn merge: one map of two that overlap.
#include <cstdio>
#include <memory>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "care/merging.h"
#include "care/whole_map.h"
#include "cli/cli.h"
#include "cli/interrupt.h"
#include "cli/loaded_map.h"
#include "engine/session_record.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct MergeCommand {
  std::string first, second, out;
  care::MergeOptions options;
  bool overwrite = false;
  bool json = false;
};

absl::StatusOr<care::Merged> RunMerge(const MergeCommand& command) {
  CAIRN_RETURN_IF_ERROR(CheckDistinct({command.out}, {command.first, command.second}));
  CAIRN_RETURN_IF_ERROR(CheckWritable(command.out, command.overwrite, /*is_map=*/true));
  CAIRN_ASSIGN_OR_RETURN(const LoadedMap first, LoadMap("merge", command.first));
  CAIRN_ASSIGN_OR_RETURN(const LoadedMap second, LoadMap("merge", command.second));
  CAIRN_RETURN_IF_ERROR(RequireKeyframes(command.first, *first.map));
  CAIRN_RETURN_IF_ERROR(RequireKeyframes(command.second, *second.map));
  Progress progress("merge", static_cast<std::int64_t>(second.map->keyframes().size()), command.json);
  CAIRN_ASSIGN_OR_RETURN(care::Merged merged, care::MergeMaps(first.map, *second.map, first.words, command.options,
                                                              engine::UnixNowNs(), [&](int done, int) {
                                                                progress.Update(done);
                                                                return true;
                                                              }));
  progress.Finish();
  if (merged.map == nullptr) return merged;
  const map::MapInfo info = care::NewMapInfo(first.map->info(), first.map->info().name);
  CAIRN_RETURN_IF_ERROR(care::WriteNewMap(*merged.map, info, first.Vocabulary(), command.out, command.overwrite,
                                          absl::StrCat("merge with ", second.map->info().name)));
  return merged;
}

std::string Reasons(const care::MergeAttempt& attempt) {
  return absl::StrJoin(attempt.rejected, "; ", [](std::string* out, const auto& entry) {
    absl::StrAppend(out, entry.first, " (", entry.second, ")");
  });
}

void PrintMerge(const MergeCommand& command, const care::Merged& merged) {
  if (merged.map == nullptr) {
    std::fputs(text::WrappedOn(stdout, absl::StrCat(text::Shown(command.first), " and ", text::Shown(command.second),
                                                    " do not overlap, as far as can be proven: nothing is written"))
                   .c_str(),
               stdout);
  } else {
    text::Say(absl::StrFormat("%s: %s, %s\n", text::Shown(command.out),
                              text::Keyframes(static_cast<std::int64_t>(merged.map->keyframes().size())),
                              text::Points(static_cast<std::int64_t>(merged.map->points().size()))));
  }
  for (const care::MergeAttempt& attempt : merged.attempts) {
    std::string told = absl::StrFormat("component %u of the second: %s looked for, %d found in the first",
                                       attempt.component.value(), text::Keyframes(attempt.keyframes), attempt.seen);
    if (attempt.joined_into) {
      absl::StrAppendFormat(&told, "; joined to component %u, lengths x %.4g, %s became one",
                            attempt.joined_into.value(), attempt.scale, text::Points(attempt.fused_points));
    } else if (attempt.seen > 0) {
      absl::StrAppendFormat(&told, "; at best %d of %d agree, %d of %d neighbours: %s", attempt.sightings_agreeing,
                            attempt.sightings_checked, attempt.neighbours_agreeing, attempt.neighbours_checked,
                            Reasons(attempt));
    }
    std::fputs(text::Wrapped(told, "  ", "    ").c_str(), stdout);
  }
  if (merged.adjusted_keyframes > 0) {
    std::printf("  %s adjusted: %.2f px per axis, as at octave 0\n", text::Keyframes(merged.adjusted_keyframes).c_str(),
                merged.adjustment_rmse_px);
  }
}

void PrintMergeJson(const MergeCommand& command, const care::Merged& merged) {
  nlohmann::ordered_json attempts = nlohmann::ordered_json::array();
  bool joined = false;
  for (const care::MergeAttempt& attempt : merged.attempts) {
    joined |= attempt.joined_into.valid();
    nlohmann::ordered_json json = {{"component", attempt.component.value()},
                                   {"keyframes", attempt.keyframes},
                                   {"seen", attempt.seen},
                                   {"agreeing", attempt.sightings_agreeing},
                                   {"checked", attempt.sightings_checked},
                                   {"neighbours_agreeing", attempt.neighbours_agreeing},
                                   {"neighbours_checked", attempt.neighbours_checked},
                                   {"rejected", attempt.rejected},
                                   {"joined_into", nullptr}};
    if (attempt.joined_into) {
      json["joined_into"] = attempt.joined_into.value();
      json["scale"] = attempt.scale;
      json["fused_points"] = attempt.fused_points;
    }
    attempts.push_back(std::move(json));
  }
  nlohmann::ordered_json json = {{"first", command.first}, {"second", command.second}, {"overlap", joined}};
  json["merged"] = merged.map == nullptr ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(command.out);
  if (merged.map != nullptr) {
    json["keyframes"] = merged.map->keyframes().size();
    json["points"] = merged.map->points().size();
    json["keyframes_adjusted"] = merged.adjusted_keyframes;
    json["adjustment_rmse_px"] = merged.adjustment_rmse_px;
  }
  json["components"] = attempts;
  PrintJson(json);
}

}  // namespace

void AddMergeCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("merge", "One map of two that overlap");
  auto command = std::make_shared<MergeCommand>();
  verb->add_option("FIRST", command->first, "Map file (.cairn); it is only read, like the other")->required();
  verb->add_option("SECOND", command->second, "Map file (.cairn), whose components are joined to those of the first")
      ->required();
  verb->add_option("-o,--out", command->out, "File of the merged map")->required();
  verb->add_flag("--apart", command->options.allow_apart,
                 "Write it even if nothing overlaps: the components lie beside each other until a session joins them");
  verb->add_flag("--overwrite", command->overwrite, "Replace a map that is there");
  verb->add_flag("--json", command->json, "Answer in JSON");
  verb->footer(
      "Overlap is proven as for a session that extends a map: several keyframes found where one similarity puts them. "
      "Where the first map is aligned to the world it stays. Exit code 4: they do not overlap, with what was tried.\n"
      "Examples:\n"
      "  cairn merge ground-floor.cairn stairs.cairn -o house.cairn\n"
      "  cairn merge monday.cairn tuesday.cairn -o week.cairn --json");
  verb->callback([=] {
    *action = [=] {
      const absl::StatusOr<care::Merged> merged = RunMerge(*command);
      if (!merged.ok()) return Fail("merge", merged.status(), command->json);
      command->json ? PrintMergeJson(*command, *merged) : PrintMerge(*command, *merged);
      return static_cast<int>(merged->map == nullptr ? kNotLocalized : kOk);
    };
  });
}

}  // namespace cairn::cli

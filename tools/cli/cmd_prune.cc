// cairn prune: makes a map smaller, at a cost that it tells.
#include <cmath>
#include <cstdio>
#include <memory>

#include "care/pruning_trial.h"
#include "cli/cli.h"
#include "cli/loaded_map.h"
#include "cli/self_query_report.h"
#include "engine/live_map.h"
#include "health/verify_map.h"
#include "store/map_overview.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct PruneCommand {
  std::string map;
  double budget_mb = 0.0;  // 0: none
  care::PruneOptions options;
  int tests = 200;
  bool dry_run = false;
  bool keep_room = false;
  bool json = false;
};

struct PruneReport {
  care::PrunePlan plan;
  std::optional<care::SelfQueries> queries;
  std::optional<std::int64_t> bytes_after;  // measured
};

absl::StatusOr<std::optional<care::SelfQueries>> AskBeforeAndAfter(const PruneCommand& command,
                                                                   const tracking::MapView& before,
                                                                   const care::PrunePlan& plan) {
  if (command.tests == 0 || before.places() == nullptr || plan.delta.empty()) return std::nullopt;
  CAIRN_ASSIGN_OR_RETURN(const auto after, before.After(plan.delta));
  inspect::CoverageOptions coverage;
  coverage.max_tests = command.tests;
  Progress progress("prune", std::min<std::int64_t>(command.tests, plan.keyframes + plan.keyframes_left), command.json);
  CAIRN_ASSIGN_OR_RETURN(const care::SelfQueries queries,
                         care::CompareSelfQueries(before, *after, coverage, [&](int done, int) {
                           progress.Update(done);
                           return true;
                         }));
  return queries;
}

absl::StatusOr<PruneReport> PlanPrune(const PruneCommand& command, const tracking::MapView& view) {
  PruneReport report;
  // Where the size is told before it is known, it is tried.
  if (command.dry_run || command.keep_room || command.options.budget_bytes) {
    CAIRN_ASSIGN_OR_RETURN(report.plan, care::TryPruning(command.map, view.snapshot(), command.options));
  } else {
    CAIRN_ASSIGN_OR_RETURN(const store::MapOverview overview, store::ReadMapOverview(command.map));
    CAIRN_ASSIGN_OR_RETURN(report.plan, care::PlanPruning(view.snapshot(), overview, command.options));
  }
  CAIRN_ASSIGN_OR_RETURN(report.queries, AskBeforeAndAfter(command, view, report.plan));
  return report;
}

absl::StatusOr<std::int64_t> CompactMap(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> store,
                         store::OpenMapStore(path, store::OpenMode::kWrite));
  CAIRN_RETURN_IF_ERROR(store->Compact());
  CAIRN_ASSIGN_OR_RETURN(const store::MapSummary summary, store->ReadSummary());
  CAIRN_RETURN_IF_ERROR(store->Close());
  return summary.file_bytes;
}

absl::StatusOr<PruneReport> RunPrune(const PruneCommand& command) {
  if (command.dry_run) {
    CAIRN_ASSIGN_OR_RETURN(const LoadedMap loaded, LoadMap("prune", command.map));
    CAIRN_ASSIGN_OR_RETURN(const auto view, loaded.View());
    return PlanPrune(command, *view);
  }
  CAIRN_RETURN_IF_ERROR(health::CheckSound(command.map));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<engine::LiveMap> live, engine::LiveMap::Open(command.map));
  PruneReport report;
  {
    engine::LiveMap::Editor editor = live->BeginEdit();
    CAIRN_ASSIGN_OR_RETURN(report, PlanPrune(command, *editor.View()));
    if (!report.plan.delta.empty()) CAIRN_RETURN_IF_ERROR(editor.Commit(report.plan.delta, {}));
  }
  CAIRN_RETURN_IF_ERROR(live->Close());
  if (!command.keep_room) {
    const absl::StatusOr<std::int64_t> compacted = CompactMap(command.map);
    if (!compacted.ok()) {
      return Annotate(compacted.status(), absl::StrCat(report.plan.keyframes,
                                                       " keyframes are gone, but the file could "
                                                       "not be compacted (cairn compact)"));
    }
    report.bytes_after = *compacted;
  }
  return report;
}

void PrintPrune(const PruneCommand& command, const PruneReport& report) {
  const care::PrunePlan& plan = report.plan;
  if (plan.keyframes + plan.keyframes_left == 0) {
    std::printf("%s: it has no keyframes: nothing %s\n", text::Shown(command.map).c_str(),
                command.dry_run ? "would go" : "is gone");
  } else {
    std::printf("%s: %lld of %lld keyframes and %lld of %lld points %s\n", text::Shown(command.map).c_str(),
                static_cast<long long>(plan.keyframes), static_cast<long long>(plan.keyframes + plan.keyframes_left),
                static_cast<long long>(plan.points), static_cast<long long>(plan.points + plan.points_left),
                command.dry_run ? "would go" : "are gone");
  }
  std::printf("  %.2f MB now, %.2f MB %s\n", static_cast<double>(plan.bytes_before) / 1e6,
              static_cast<double>(report.bytes_after.value_or(plan.bytes_after)) / 1e6,
              report.bytes_after ? "without them" : "once compacted");
  if (!report.queries || report.queries->whole.views == 0) return;
  PrintSelfQueries(*report.queries);
}

void PrintPruneJson(const PruneCommand& command, const PruneReport& report) {
  const care::PrunePlan& plan = report.plan;
  nlohmann::ordered_json json = {{"map", command.map},
                                 {"dry_run", command.dry_run},
                                 {"keyframes_removed", plan.keyframes},
                                 {"keyframes_left", plan.keyframes_left},
                                 {"points_removed", plan.points},
                                 {"points_left", plan.points_left},
                                 {"bytes_before", plan.bytes_before},
                                 {"bytes_predicted", plan.bytes_after}};
  if (report.bytes_after) json["bytes_after"] = *report.bytes_after;
  if (report.queries) json.update(SelfQueriesAsJson(*report.queries));
  PrintJson(json);
}

}  // namespace

void AddPruneCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("prune", "Make a map smaller: keyframes that show what others show go");
  auto command = std::make_shared<PruneCommand>();
  verb->add_option("MAP", command->map, "Map file (.cairn)")->required();
  verb->add_option("--budget-mb", command->budget_mb,
                   "Keyframes go, the most redundant first, until the file has at most so many megabytes (10^6 bytes); "
                   "tried on copies beside it")
      ->check(CLI::PositiveNumber);
  verb->add_option(
          "--redundancy", command->options.min_redundancy,
          "Without a budget: what goes is as redundant as this. Half of it is the mean of the shares of a keyframe's "
          "points that one, two and three others see as well, half the largest share that a single one sees")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1.0));
  verb->add_flag("--dry-run", command->dry_run, "Say what would go and what it would cost; change nothing");
  verb->add_option("--tests", command->tests, "Keyframes that are looked for before and after; 0: none")
      ->capture_default_str()
      ->check(CLI::NonNegativeNumber);
  verb->add_flag("--keep-room", command->keep_room, "Do not compact the file: what comes next will use the room");
  verb->add_flag("--json", command->json, "Answer in JSON");
  verb->footer(
      "There is no way back: take a cairn snapshot before.\n"
      "Examples:\n"
      "  cairn prune office.cairn --dry-run\n"
      "  cairn prune office.cairn --budget-mb 20\n"
      "  cairn prune office.cairn --redundancy 0.8 --json");
  verb->callback([=] {
    *action = [=] {
      if (command->options.min_redundancy == 0.0) {
        return FailUsage("prune", "--redundancy: 0 is what every keyframe has: all would go", command->json);
      }
      if (command->budget_mb > 0.0) {
        command->options.budget_bytes = static_cast<std::int64_t>(std::llround(command->budget_mb * 1e6));
      }
      const absl::StatusOr<PruneReport> report = RunPrune(*command);
      if (!report.ok()) return Fail("prune", report.status(), command->json);
      command->json ? PrintPruneJson(*command, *report) : PrintPrune(*command, *report);
      return static_cast<int>(kOk);
    };
  });
}

}  // namespace cairn::cli

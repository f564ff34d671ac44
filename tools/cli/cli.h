// What the verbs of `cairn` share: registration, exit codes, output for people and machines, progress.
// A verb is one file: it declares its options on a CLI11 subcommand and leaves an Action that main() runs.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/status.h"
#include "cli/outputs.h"
#include "cli/progress.h"

namespace cairn::cli {

// Exit codes, as documented in the README.
enum ExitCode { kOk = 0, kFailure = 1, kUsage = 2, kDamagedMap = 3, kNotLocalized = 4, kNewerVersion = 5 };

using Action = std::function<int()>;

void AddRunCommand(CLI::App& app, Action* action);
void AddLocalizeCommand(CLI::App& app, Action* action);
void AddTrackCommand(CLI::App& app, Action* action);
void AddInfoCommand(CLI::App& app, Action* action);
void AddLsCommand(CLI::App& app, Action* action);
void AddExportCommand(CLI::App& app, Action* action);
void AddCoverageCommand(CLI::App& app, Action* action);
void AddExplainCommand(CLI::App& app, Action* action);
void AddShowCommand(CLI::App& app, Action* action);
void AddStatsCommand(CLI::App& app, Action* action);
void AddAlignCommand(CLI::App& app, Action* action);
void AddDiffCommand(CLI::App& app, Action* action);
void AddSessionCommand(CLI::App& app, Action* action);
void AddPruneCommand(CLI::App& app, Action* action);
void AddCompactCommand(CLI::App& app, Action* action);
void AddPackCommand(CLI::App& app, Action* action);
void AddImportCommand(CLI::App& app, Action* action);
void AddRenderCommand(CLI::App& app, Action* action);
void AddMergeCommand(CLI::App& app, Action* action);
void AddSplitCommand(CLI::App& app, Action* action);
void AddLogCommand(CLI::App& app, Action* action);
void AddCreateCommand(CLI::App& app, Action* action);
void AddSnapshotCommand(CLI::App& app, Action* action);
void AddDeleteCommand(CLI::App& app, Action* action);
void AddRestoreCommand(CLI::App& app, Action* action);
void AddTopCommand(CLI::App& app, Action* action);
void AddVerifyCommand(CLI::App& app, Action* action);
void AddRecoverCommand(CLI::App& app, Action* action);
void AddEvalCommand(CLI::App& app, Action* action);
void AddBenchCommand(CLI::App& app, Action* action);
void AddVocabCommand(CLI::App& app, Action* action);
void AddSynthCommand(CLI::App& app, Action* action);
void AddCameraCommand(CLI::App& app, Action* action);

// Prints "cairn VERB: message" to standard error, or {"error": ...} to standard output when the verb answers in JSON.
// Gives the exit code that fits the status: that of usage errors for those of UsageError().
int Fail(const std::string& verb, const absl::Status& status, bool json);

// The same for a usage error that an option's check did not find.
int FailUsage(const std::string& verb, const std::string& message, bool json);

// "frame" and "unit" of the positions of an answer: "world" and "m" if the map is aligned, else "map" and "map units".
void AddFrameAndUnit(bool in_world, nlohmann::ordered_json* json);

// One line of JSON with keys in the order given.
void PrintJson(const nlohmann::ordered_json& json);

}  // namespace cairn::cli

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

namespace cairn::cli {

// Exit codes, as documented in the README.
enum ExitCode { kOk = 0, kFailure = 1, kUsage = 2, kDamagedMap = 3, kNotLocalized = 4, kNewerVersion = 5 };

using Action = std::function<int()>;

void AddRunCommand(CLI::App& app, Action* action);
void AddLocalizeCommand(CLI::App& app, Action* action);
void AddInfoCommand(CLI::App& app, Action* action);
void AddAlignCommand(CLI::App& app, Action* action);
void AddEvalCommand(CLI::App& app, Action* action);
void AddBenchCommand(CLI::App& app, Action* action);
void AddVocabCommand(CLI::App& app, Action* action);
void AddSynthCommand(CLI::App& app, Action* action);
void AddCameraCommand(CLI::App& app, Action* action);

// Prints "cairn VERB: message" to standard error, or {"error": ...} to standard output when the verb answers in JSON.
// Gives the exit code that fits the status.
int Fail(const std::string& verb, const absl::Status& status, bool json);

// One line of JSON with keys in the order given.
void PrintJson(const nlohmann::ordered_json& json);

// OK if `path` may be written: its folder can be, and it does not exist, or is a file and `overwrite`. The message
// names the remedy. What is no map never replaces one, nor a file that belongs to one.
absl::Status CheckWritable(const std::string& path, bool overwrite, bool is_map = false);

// InvalidArgument if two outputs are the same file, or an output is one of the inputs, or a file in a folder
// that is one (unless it looks like an earlier map, trajectory or drawing); empty names count for nothing.
absl::Status CheckDistinct(const std::vector<std::string>& outputs, const std::vector<std::string>& inputs);

// InvalidArgument unless the name is empty or ends in .png or .svg.
absl::Status CheckPicture(const std::string& path);

// A bar that redraws itself on a terminal, and a plain line every tenth otherwise. Writes to standard error.
class Progress {
 public:
  Progress(std::string label, std::int64_t total, bool quiet);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // `note` stands behind the bar: "42 keyframes, 61 frames/s".
  void Update(std::int64_t done, const std::string& note = "");
  void Finish(const std::string& note = "");

 private:
  void Draw(std::int64_t done, const std::string& note);

  std::string label_;
  std::int64_t total_;
  bool quiet_;
  bool terminal_;
  bool finished_ = false;
  std::int64_t last_tenth_ = -1;
  double last_drawn_s_ = -1.0;
};

}  // namespace cairn::cli

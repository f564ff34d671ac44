// The options by which every verb that reads images chooses its sequence.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <string>
#include <vector>

#include "io/frame_source.h"

namespace cairn::cli {

struct InputOptions {
  std::string sequence;
  std::string format = "auto";
  io::OpenOptions open;
};

// DATASET, --camera, --photometric, --mask, --camera-index, --format, --from, --until, --stride.
void AddInputOptions(CLI::App* verb, InputOptions* options);

// All that is read: not to be overwritten by what is written.
std::vector<std::string> InputFiles(const InputOptions& options);

// What was understood of the files that is not as usual is told on standard error.
absl::StatusOr<std::unique_ptr<io::FrameSource>> OpenInput(const InputOptions& options, const std::string& verb);
void TellNotes(const std::string& verb, const std::vector<std::string>& notes);

// Images that could not be used: the first few are told as they come, all are counted.
class SkippedFrames {
 public:
  SkippedFrames(std::string verb, bool quiet) : verb_(std::move(verb)), quiet_(quiet) {}
  void Add(const std::string& path, const absl::Status& status);
  std::int64_t count() const { return count_; }

 private:
  std::string verb_;
  bool quiet_;
  std::int64_t count_ = 0;
};

}  // namespace cairn::cli

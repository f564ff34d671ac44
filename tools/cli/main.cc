// `cairn`: one binary, one verb per file.
#include <absl/strings/numbers.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <string>
#include <vector>

#include "base/cpu_features.h"
#include "base/version.h"
#include "cli/cli.h"

namespace {

// CLI11 would take whatever follows an option with an optional value: --realtime takes only a number.
std::vector<std::string> Arguments(int argc, char** argv) {
  std::vector<std::string> arguments(argv + 1, argv + argc);
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    if (arguments[i] != "--realtime") continue;
    double speed;
    const bool given = i + 1 < arguments.size() && absl::SimpleAtod(arguments[i + 1], &speed);
    arguments[i] += given ? "=" + arguments[i + 1] : "=1";
    if (given) arguments.erase(arguments.begin() + static_cast<std::ptrdiff_t>(i) + 1);
  }
  return arguments;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace cairn::cli;
  cv::setNumThreads(1);  // OpenCV's threads fight ours
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_ERROR);
  spdlog::set_default_logger(spdlog::stderr_color_mt("cairn"));
  spdlog::set_pattern("%^%l%$: %v");

  if (const auto level = cairn::RequestedSimdLevel(); !level.ok()) {
    spdlog::error("{}", std::string(level.status().message()));
    return kUsage;
  }

  CLI::App app("Cairn turns camera streams into persistent maps and answers \"where is this camera?\" against them.",
               "cairn");
  app.set_version_flag("--version", std::string("cairn ") + cairn::kVersion);
  app.require_subcommand(1);
  app.footer(
      "Exit codes: 0 ok, 1 failure, 2 usage, 3 map damaged, 4 not localized, 5 version, 130 and 143 interrupted.\n"
      "Each verb has its own --help, with examples.");

  Action action;
  AddRunCommand(app, &action);
  AddLocalizeCommand(app, &action);
  AddInfoCommand(app, &action);
  AddAlignCommand(app, &action);
  AddEvalCommand(app, &action);
  AddBenchCommand(app, &action);
  AddVocabCommand(app, &action);
  AddSynthCommand(app, &action);
  AddCameraCommand(app, &action);

  try {
    std::vector<std::string> arguments = Arguments(argc, argv);
    std::reverse(arguments.begin(), arguments.end());  // as CLI11 wants them
    app.parse(std::move(arguments));
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kOk : kUsage;
  }
  return action();
}

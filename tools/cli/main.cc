// `cairn`: one binary, one verb per file.
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>

#include "base/version.h"
#include "cli/cli.h"

int main(int argc, char** argv) {
  using namespace cairn::cli;
  cv::setNumThreads(1);  // OpenCV's threads fight ours
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_ERROR);
  spdlog::set_default_logger(spdlog::stderr_color_mt("cairn"));
  spdlog::set_pattern("%^%l%$: %v");

  CLI::App app("Cairn turns camera streams into persistent maps and answers \"where is this camera?\" against them.",
               "cairn");
  app.set_version_flag("--version", std::string("cairn ") + cairn::kVersion);
  app.require_subcommand(1);
  app.footer(
      "Exit codes: 0 ok, 1 failure, 2 usage, 3 map damaged, 4 not localized, 5 version.\n"
      "Each verb has its own --help, with examples.");

  Action action;
  AddRunCommand(app, &action);
  AddLocalizeCommand(app, &action);
  AddInfoCommand(app, &action);
  AddAlignCommand(app, &action);
  AddEvalCommand(app, &action);
  AddVocabCommand(app, &action);
  AddSynthCommand(app, &action);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kOk : kUsage;
  }
  return action();
}

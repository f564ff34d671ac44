// cairnd: the map server.
#include <google/protobuf/stubs/logging.h>
#include <malloc.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <thread>

#include "absl/strings/str_replace.h"
#include "base/guarded.h"
#include "base/version.h"
#include "server/daemon/daemon.h"
#include "server/daemon/settings.h"
#include "token_command.h"

namespace cairn::server {
namespace {

// As those of `cairn`.
enum ExitCode { kOk = 0, kFailure = 1, kUsage = 2 };

constexpr std::chrono::seconds kGrace(2);

// Signals that end the server, kept from all threads: they are waited for.
sigset_t EndingSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGTERM, SIGINT, SIGHUP}) sigaddset(&signals, signal);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  return signals;
}

// Threads come with every session and stay in pools; each part of the heap that they are given keeps the holes which
// sessions leave. As many parts as processors are all that can be at work at once.
void LimitHeaps() {
#ifdef __GLIBC__
  mallopt(M_ARENA_MAX, static_cast<int>(std::max(2u, std::thread::hardware_concurrency())));
#endif
}

// What the command line says: the text of each setting that it gives.
struct CommandLine {
  std::string config;
  bool check_config = false;
  std::map<std::string, std::string> texts;
};

std::string OptionOf(const Setting& setting) {
  return absl::StrCat("--", absl::StrReplaceAll(setting.key, {{"_", "-"}}));
}

void AddOptions(CLI::App& app, const std::vector<Setting>& settings, CommandLine* line) {
  app.add_option("--config", line->config,
                 "File of settings (cairnd.yaml); each is an option here, too, which counts more");
  app.add_flag("--check-config", line->check_config, "Say whether the settings are right, and end");
  for (const Setting& setting : settings) {
    const std::string option = OptionOf(setting);
    const auto given = [line, key = setting.key](const std::string& text) { line->texts[key] = text; };
    if (setting.is_flag) {
      app.add_flag_callback(
          option, [given] { given("true"); }, setting.help);
    } else {
      app.add_option_function<std::string>(option, given, setting.help)->default_str(setting.standard);
    }
  }
  app.footer(
      "Ends in order with SIGTERM or Ctrl-C.\n"
      "Examples:\n"
      "  cairnd --maps maps/\n"
      "  cairnd --config cairnd.yaml --check-config\n"
      "  cairnd --config cairnd.yaml token create robot_1 --maps 'office,lab*' --rights extend\n"
      "  cairn --server localhost:7878 localize photo.jpg --camera camera.yaml --map office");
}

absl::Status Apply(const CommandLine& line, const std::vector<Setting>& settings) {
  if (!line.config.empty()) CAIRN_RETURN_IF_ERROR(LoadSettings(line.config, settings));
  for (const Setting& setting : settings) {
    const auto text = line.texts.find(setting.key);
    if (text == line.texts.end()) continue;
    const absl::Status set = setting.set(text->second);
    if (!set.ok()) return absl::InvalidArgumentError(absl::StrCat(OptionOf(setting), " ", set.message()));
  }
  return absl::OkStatus();
}

int Complain(const absl::Status& status) {
  std::cerr << "cairnd: " << status.message() << "\n";
  return absl::IsInvalidArgument(status) ? kUsage : kFailure;
}

int Serve(const DaemonOptions& options, const sigset_t& signals) {
  const absl::StatusOr<std::unique_ptr<Daemon>> daemon = Daemon::Start(options);
  if (!daemon.ok()) return Complain(daemon.status());
  std::cout << "cairnd " << kVersion << ": maps of " << options.maps.directory << ", gRPC on "
            << (*daemon)->grpc_address()
            << (!options.no_http ? absl::StrCat(", HTTP on ", (*daemon)->http_address()) : "") << std::endl;
  std::cout << "  " << options.ProtectionText() << std::endl;
  for (const std::string& warning : options.Warnings()) spdlog::warn("{}", warning);
  const timespec second{1, 0};
  int signal = -1;
  while (signal < 0) {
    signal = sigtimedwait(&signals, nullptr, &second);
    (*daemon)->Tick(std::chrono::steady_clock::now());
  }
  spdlog::info("{}: stopping", strsignal(signal));
  (*daemon)->Stop(kGrace);
  return kOk;
}

int Main(int argc, char** argv) {
  LimitHeaps();
  const sigset_t signals = EndingSignals();
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);  // writing beyond the limit is an error like a full disk
  // What goes wrong with a call is in its answer and in our own log.
  setenv("GRPC_VERBOSITY", "NONE", /*overwrite=*/0);
  google::protobuf::SetLogHandler(nullptr);
  cv::setNumThreads(1);  // OpenCV's threads fight ours
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  spdlog::set_default_logger(spdlog::stderr_color_mt("cairnd"));
  spdlog::set_pattern("%Y-%m-%dT%H:%M:%S.%e %l %v");
  CLI::App app("Serves the maps of a directory: where is this camera?", "cairnd");
  app.set_version_flag("--version", std::string("cairnd ") + kVersion);
  DaemonOptions options;
  const std::vector<Setting> settings = SettingsOf(&options);
  CommandLine line;
  AddOptions(app, settings, &line);
  TokenAction token_action;
  const auto tokens_file = [&]() -> absl::StatusOr<std::string> {
    CAIRN_RETURN_IF_ERROR(Apply(line, settings));
    if (!options.access.tokens.empty()) return options.access.tokens;
    return absl::InvalidArgumentError("name the file: --tokens FILE, or --config FILE that has the key `tokens`");
  };
  AddTokenCommand(app, tokens_file, &token_action);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    const int code = app.exit(error);
    return code == 0 ? kOk : kUsage;
  }
  if (token_action) {
    const absl::Status done = token_action();
    return done.ok() ? kOk : Complain(done);
  }
  absl::Status status = Apply(line, settings);
  if (status.ok()) status = options.Validate();
  if (status.ok() && line.check_config) status = options.CheckFiles();
  if (!status.ok()) return Complain(status);
  if (line.check_config) {
    for (const std::string& warning : options.Warnings()) std::cerr << "cairnd: warning: " << warning << "\n";
    std::cout << "the settings are right\n";
    return kOk;
  }
  return Serve(options, signals);
}

}  // namespace
}  // namespace cairn::server

int main(int argc, char** argv) {
  int code = cairn::server::kFailure;
  const absl::Status status = cairn::Guarded([&] {
    code = cairn::server::Main(argc, argv);
    return absl::OkStatus();
  });
  if (!status.ok()) std::cerr << "cairnd: " << status.message() << "\n";
  return code;
}

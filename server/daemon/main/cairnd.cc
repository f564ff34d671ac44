// cairnd: the map server.
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>

#include "base/guarded.h"
#include "base/version.h"
#include "server/daemon/daemon.h"

namespace cairn::server {
namespace {

// As those of `cairn`.
enum ExitCode { kOk = 0, kFailure = 1, kUsage = 2 };

constexpr std::chrono::seconds kGrace(3);

// Signals that end the server, kept from all threads: they are waited for.
sigset_t EndingSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGTERM, SIGINT, SIGHUP}) sigaddset(&signals, signal);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  return signals;
}

void AddOptions(CLI::App& app, DaemonOptions* options) {
  app.add_option("--maps", options->maps.directory, "Directory of the maps: NAME.cairn is served as NAME")->required();
  app.add_option("--listen", options->grpc.address, "HOST:PORT or unix:/path for gRPC; port 0: any that is free")
      ->capture_default_str();
  app.add_option("--listen-http", options->http.address, "HOST:PORT for HTTP: REST, health, metrics")
      ->capture_default_str();
  app.add_flag("!--no-http", options->serve_http, "gRPC only");
  app.add_flag("--without-protection", options->without_protection,
               "Listen also where other machines reach it: everyone who does may do everything");
  app.add_option_function<double>(
         "--memory-mb",
         [options](double mb) { options->maps.memory_budget_bytes = static_cast<std::int64_t>(1e6 * mb); },
         "Of all open maps together, roughly; those used longest ago are closed first")
      ->default_str("4000")
      ->check(CLI::NonNegativeNumber);
  app.add_option("--idle-close-s", options->maps.idle_close_s, "A map that nobody has asked for so long is closed")
      ->capture_default_str();
  app.add_option("--max-sessions", options->maps.max_sessions, "Sessions at the same time")->capture_default_str();
  app.add_option("--session-wait-s", options->maps.session_wait_s,
                 "A session whose client is cut off waits so long for it, and is then finished")
      ->capture_default_str();
  app.add_option("--workers", options->maps.workers,
                 "Images that are located at the same time (0: as many as processors)")
      ->capture_default_str();
  app.footer(
      "Ends in order with SIGTERM or Ctrl-C.\n"
      "Examples:\n"
      "  cairnd --maps maps/\n"
      "  cairn --server localhost:7878 localize photo.jpg --camera camera.yaml --map office");
}

int Serve(const DaemonOptions& options, const sigset_t& signals) {
  const absl::StatusOr<std::unique_ptr<Daemon>> daemon = Daemon::Start(options);
  if (!daemon.ok()) {
    std::cerr << "cairnd: " << daemon.status().message() << "\n";
    return absl::IsInvalidArgument(daemon.status()) ? kUsage : kFailure;
  }
  std::cout << "cairnd " << kVersion << ": maps of " << options.maps.directory << ", gRPC on "
            << (*daemon)->grpc_address()
            << (options.serve_http ? absl::StrCat(", HTTP on ", (*daemon)->http_address()) : "") << std::endl;
  if (!options.without_protection) {
    std::cout << "  only this machine reaches it; cairnd --help says how to go beyond" << std::endl;
  }
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
  const sigset_t signals = EndingSignals();
  std::signal(SIGPIPE, SIG_IGN);
  setenv("GRPC_VERBOSITY", "NONE", /*overwrite=*/0);  // what goes wrong is in the answers
  cv::setNumThreads(1);                               // OpenCV's threads fight ours
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  spdlog::set_default_logger(spdlog::stderr_color_mt("cairnd"));
  spdlog::set_pattern("%Y-%m-%dT%H:%M:%S.%e %l %v");
  CLI::App app("Serves the maps of a directory: where is this camera?", "cairnd");
  app.set_version_flag("--version", std::string("cairnd ") + kVersion);
  DaemonOptions options;
  AddOptions(app, &options);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    const int code = app.exit(error);
    return code == 0 ? kOk : kUsage;
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

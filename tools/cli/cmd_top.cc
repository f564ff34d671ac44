// cairn top: how a server is doing, again and again.
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <mutex>
#include <optional>

#include "cli/cli.h"
#include "cli/interrupt.h"
#include "cli/server_option.h"
#include "cli/status_report.h"

namespace cairn::cli {
namespace {

struct TopOptions {
  ServerChoice server;
  double interval_s = 2.0;
  int count = 0;  // looks; 0: until it is interrupted
  bool once = false;
  bool json = false;
};

// Lets a pause end early.
class Pause {
 public:
  // True if it was ended.
  bool Wait(double seconds) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return ended_; });
  }
  void End() {
    const std::lock_guard lock(mutex_);
    ended_ = true;
    changed_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool ended_ = false;
};

// False: nobody reads it any more, or it cannot be written.
bool Show(const std::vector<std::string>& lines, bool terminal) {
  // Home, each line to its end, then what is below: without the flicker of clearing all of it.
  if (terminal) std::fputs("\x1b[H", stdout);
  for (const std::string& line : lines) std::printf("%s%s\n", line.c_str(), terminal ? "\x1b[K" : "");
  std::fputs(terminal ? "\x1b[J" : "\n", stdout);
  return std::fflush(stdout) == 0;
}

absl::StatusOr<int> Top(const TopOptions& options) {
  InterruptWatch interrupts;
  Pause pause;
  const InterruptWatch::Guard guard(&interrupts, [&] { pause.End(); });
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::RemoteMapService> service, ConnectTo(options.server));
  const bool once = options.once || options.json;
  const bool terminal = !once && isatty(STDOUT_FILENO) != 0;
  if (terminal) std::fputs("\x1b[2J", stdout);
  std::optional<api::ServerStatus> before;
  for (int looks = 1;; ++looks) {
    const absl::StatusOr<api::ServerStatus> looked = service->Status();
    // Once seen it may be gone for a while: who watches wants to see it come back.
    if (absl::IsUnavailable(looked.status()) && before) {
      Show({std::string(looked.status().message())}, terminal);
      if (looks == options.count || pause.Wait(options.interval_s)) return interrupts.exit_code();
      continue;
    }
    CAIRN_RETURN_IF_ERROR(looked.status());
    const api::ServerStatus& now = *looked;
    if (before && now.uptime_s < before->uptime_s) before.reset();  // it was started anew
    const double seconds = before ? now.uptime_s - before->uptime_s : now.uptime_s;
    const api::ServerStatus* since = before ? &*before : nullptr;
    if (options.json) {
      PrintJson(StatusAsJson(options.server.address, now, since, seconds));
    } else if (!Show(StatusLines(options.server.address, now, since, seconds, terminal), terminal)) {
      if (errno != EPIPE)
        return absl::DataLossError(absl::StrCat("writing to standard output: ", std::strerror(errno)));
      std::clearerr(stdout);
      return 128 + SIGPIPE;  // who read it has had enough, as with any program
    }
    if (once || looks == options.count || pause.Wait(options.interval_s)) return interrupts.exit_code();
    before = now;
  }
}

}  // namespace

void AddTopCommand(CLI::App& app, Action* action) {
  CLI::App* verb =
      app.add_subcommand("top", "How a server is doing: maps, sessions, rates, latencies, misses by stage");
  auto options = std::make_shared<TopOptions>();
  verb->add_option("--interval", options->interval_s, "Seconds between two looks")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
  verb->add_option("--count", options->count, "Look so many times; by default until it is interrupted")
      ->check(CLI::PositiveNumber);
  verb->add_flag("--once", options->once, "Look once: everything since the server was started");
  verb->add_flag("--json", options->json, "Look once, and answer in JSON");
  verb->footer(
      "Where the output is no terminal, each look is a block of lines with an empty one behind it.\n"
      "Examples:\n"
      "  cairn --server localhost:7878 top\n"
      "  cairn --server localhost:7878 top --once");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      if (options->server.empty()) return FailUsage("top", "give --server HOST:PORT before the verb", options->json);
      const absl::StatusOr<int> code = Top(*options);
      return code.ok() ? *code : Fail("top", code.status(), options->json);
    };
  });
}

}  // namespace cairn::cli

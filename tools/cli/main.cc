// `cairn`: one binary, one verb per file.
#include <fcntl.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <iostream>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_join.h"
#include "base/cpu_features.h"
#include "base/guarded.h"
#include "base/version.h"
#include "cli/cli.h"
#include "cli/help_format.h"
#include "cli/server_option.h"

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

// Files that are opened must not come to stand where standard output or error is expected: what is closed is opened in
// a way that refuses to be written.
void FillStandardStreams() {
  for (int fd = 0; fd <= 2; ++fd) {
    if (fcntl(fd, F_GETFD) < 0 && open("/dev/null", fd == 0 ? O_WRONLY : O_RDONLY) != fd) return;
  }
}

// The last resort, where nobody caught what a library threw: a message and an exit code. Maps are good at any time.
[[noreturn]] void EndInOrder() {
  const absl::Status status =
      std::current_exception() ? cairn::StatusOfException() : absl::InternalError("it ended where it never should");
  std::fprintf(stderr, "cairn: %.*s\n", static_cast<int>(status.message().size()), status.message().data());
  std::_Exit(cairn::cli::kFailure);
}

struct Call {
  std::vector<std::string> arguments;
  std::string verb;  // "eval ate"; known once it has been parsed
  bool json = false;
};

std::string VerbNames(const CLI::App& app) {
  return absl::StrJoin(app.get_subcommands({}), ", ",
                       [](std::string* out, const CLI::App* verb) { out->append(verb->get_name()); });
}

// From the first one on that is no option of `cairn` itself, as --server HOST.
std::vector<std::string> FromVerb(const CLI::App& app, const std::vector<std::string>& arguments) {
  std::size_t at = 0;
  while (at < arguments.size() && absl::StartsWith(arguments[at], "--")) {
    const std::string name = arguments[at].substr(0, arguments[at].find('='));
    const CLI::Option* const option = app.get_option_no_throw(name);
    const bool takes_next = option != nullptr && option->get_items_expected_max() > 0 && name == arguments[at];
    at += takes_next ? 2 : 1;
  }
  at = std::min(at, arguments.size());
  return {arguments.begin() + static_cast<std::ptrdiff_t>(at), arguments.end()};
}

// What to say of a verb that there is not; empty if there is.
std::string UnknownVerb(const CLI::App& app, const std::vector<std::string>& arguments) {
  const CLI::App* at = &app;
  std::string path = "cairn";
  for (const std::string& argument : arguments) {
    const std::vector<const CLI::App*> verbs = at->get_subcommands({});
    if (verbs.empty() || absl::StartsWith(argument, "-")) return "";
    const auto named =
        std::find_if(verbs.begin(), verbs.end(), [&](const CLI::App* verb) { return verb->get_name() == argument; });
    if (named == verbs.end()) {
      // `cairn synth` takes the name of a world, too.
      const bool takes_others = !at->get_options([](const CLI::Option* o) { return o->get_positional(); }).empty();
      if (takes_others) return "";
      return absl::StrCat("there is no verb \"", argument, "\" of ", path, "; there are ", VerbNames(*at));
    }
    at = *named;
    absl::StrAppend(&path, " ", argument);
  }
  return "";
}

// The verb that was called, as far as its arguments name it: "eval ate".
std::string VerbOf(const CLI::App& app, const std::vector<std::string>& arguments) {
  const CLI::App* at = &app;
  std::string verb;
  for (const std::string& argument : arguments) {
    const std::vector<const CLI::App*> verbs = at->get_subcommands({});
    const auto named =
        std::find_if(verbs.begin(), verbs.end(), [&](const CLI::App* known) { return known->get_name() == argument; });
    if (named == verbs.end()) break;
    at = *named;
    absl::StrAppend(&verb, verb.empty() ? "" : " ", argument);
  }
  return verb;
}

// CLI11 tells ranges with every digit of the largest double.
std::string InPlainNumbers(const CLI::App& app, const std::string& message) {
  const std::string value_is = ": Value ", not_in = " not in range ", up_to = " to ";
  const std::size_t value = message.find(value_is), range = message.find(not_in), to = message.find(up_to, range);
  if (value == std::string::npos || range == std::string::npos || to == std::string::npos) return message;
  const std::string name = message.substr(0, value);
  const std::string given = message.substr(value + value_is.size(), range - value - value_is.size());
  double low = 0.0, high = 0.0;
  if (!absl::SimpleAtod(message.substr(range + not_in.size(), to - range - not_in.size()), &low) ||
      !absl::SimpleAtod(message.substr(to + up_to.size()), &high)) {
    return message;
  }
  double number;
  if (!absl::SimpleAtod(given, &number) || !std::isfinite(number)) {
    return absl::StrCat(name, ": ", given, " is no number");
  }
  if (high < 1e300) return absl::StrCat(name, ": ", given, " is not within ", low, " to ", high);
  const CLI::App* verb = &app;
  while (!verb->get_subcommands().empty()) verb = verb->get_subcommands().front();
  const CLI::Option* const option = verb->get_option_no_throw(name);
  const bool positive = option != nullptr && absl::StrContains(option->get_type_name(), "POSITIVE");
  return absl::StrCat(name, ": ", given, positive ? " is not larger than 0" : " is less than 0");
}

// An option with nothing behind its `=`: CLI11 would take what follows for its value, another option even. Shells leave
// that of a variable that is not set.
std::string EmptyValue(const std::vector<std::string>& arguments) {
  for (const std::string& argument : arguments) {
    if (argument == "--") break;
    if (!absl::StartsWith(argument, "--") || argument.find('=') + 1 != argument.size()) continue;
    return absl::StrCat(argument.substr(0, argument.size() - 1), " has no value behind its =");
  }
  return "";
}

// A number that is none passes every range that options are checked against, and one without a sign takes a negative
// one for a large one.
std::string NotANumber(const CLI::App& app) {
  for (const CLI::Option* option : app.get_options()) {
    if (absl::StartsWith(option->get_type_name(), "UINT")) {
      for (const std::string& given : option->results()) {
        if (absl::StartsWith(given, "-")) return absl::StrCat(option->get_name(), ": ", given, " is less than 0");
      }
    }
    if (!absl::StartsWith(option->get_type_name(), "FLOAT")) continue;
    for (const std::string& given : option->results()) {
      double number = 0.0;
      if (absl::SimpleAtod(given, &number) && std::isnan(number)) {
        return absl::StrCat(option->get_name(), ": ", given, " is no number");
      }
    }
  }
  for (const CLI::App* verb : app.get_subcommands()) {
    if (std::string found = NotANumber(*verb); !found.empty()) return found;
  }
  return "";
}

int ParseAndRun(Call* call) {
  using namespace cairn::cli;
  if (const auto level = cairn::RequestedSimdLevel(); !level.ok()) {
    return FailUsage("", std::string(level.status().message()), call->json);
  }
  CLI::App app("Cairn turns camera streams into persistent maps and answers \"where is this camera?\" against them.",
               "cairn");
  app.set_version_flag("--version", std::string("cairn ") + cairn::kVersion);
  app.require_subcommand(1);
  app.footer(
      "Exit codes: 0 ok, 1 failure, 2 usage, 3 map damaged, 4 not localized, 5 version, 129, 130 and 143 interrupted.\n"
      "Each verb has its own --help, with examples.");

  app.formatter(std::make_shared<HelpFormat>());  // verbs take it over
  AddServerOption(app);
  Action action;
  AddRunCommand(app, &action);
  AddLocalizeCommand(app, &action);
  AddTrackCommand(app, &action);
  AddInfoCommand(app, &action);
  AddLsCommand(app, &action);
  AddExportCommand(app, &action);
  AddShowCommand(app, &action);
  AddExplainCommand(app, &action);
  AddCoverageCommand(app, &action);
  AddStatsCommand(app, &action);
  AddAlignCommand(app, &action);
  AddDiffCommand(app, &action);
  AddSessionCommand(app, &action);
  AddPruneCommand(app, &action);
  AddCompactCommand(app, &action);
  AddPackCommand(app, &action);
  AddImportCommand(app, &action);
  AddRenderCommand(app, &action);
  AddMergeCommand(app, &action);
  AddSplitCommand(app, &action);
  AddLogCommand(app, &action);
  AddCreateCommand(app, &action);
  AddSnapshotCommand(app, &action);
  AddDeleteCommand(app, &action);
  AddRestoreCommand(app, &action);
  AddTopCommand(app, &action);
  AddVerifyCommand(app, &action);
  AddRecoverCommand(app, &action);
  AddEvalCommand(app, &action);
  AddBenchCommand(app, &action);
  AddVocabCommand(app, &action);
  AddSynthCommand(app, &action);
  AddCameraCommand(app, &action);

  const std::vector<std::string> from_verb = FromVerb(app, call->arguments);
  if (const std::string unknown = UnknownVerb(app, from_verb); !unknown.empty()) {
    return FailUsage("", unknown, call->json);
  }
  call->verb = VerbOf(app, from_verb);
  const bool names_server =
      from_verb.size() < call->arguments.size() &&
      std::any_of(call->arguments.begin(), call->arguments.end() - static_cast<std::ptrdiff_t>(from_verb.size()),
                  [](const std::string& a) { return a == "--server" || absl::StartsWith(a, "--server="); });
  const bool asks_help = std::find(from_verb.begin(), from_verb.end(), "--help") != from_verb.end();
  if (names_server && !from_verb.empty() && !asks_help && !AsksServers(from_verb[0])) {
    return FailUsage(call->verb, "it works on files: not with --server", call->json);
  }
  if (const std::string empty = EmptyValue(call->arguments); !empty.empty()) {
    return FailUsage(call->verb, empty, call->json);
  }
  try {
    std::vector<std::string> arguments = call->arguments;
    std::reverse(arguments.begin(), arguments.end());  // as CLI11 wants them
    app.parse(std::move(arguments));
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
    const std::string help = absl::StrCat("; see cairn ", call->verb, call->verb.empty() ? "" : " ", "--help");
    return FailUsage(call->verb, absl::StrCat(InPlainNumbers(app, error.what()), call->json ? "" : help), call->json);
  }
  if (const std::string found = NotANumber(app); !found.empty()) return FailUsage(call->verb, found, call->json);
  const std::string verb = app.get_subcommands().front()->get_name();
  if (!ServerOf(app).address.empty() && !AsksServers(verb)) {
    return FailUsage(verb, "it works on files: not with --server", call->json);
  }
  return action();
}

// An answer that did not arrive is none. A reader that went away has had enough, as with any program.
int CloseOutput(const Call& call, int code) {
  errno = 0;
  std::cout.flush();
  const bool written = std::fflush(stdout) == 0 && std::ferror(stdout) == 0 && std::cout.good();
  const int error = errno;
  std::fflush(stderr);
  if (written) return code;
  const bool answered = code == cairn::cli::kOk || code == cairn::cli::kNotLocalized;
  if (error == EPIPE) return answered ? 128 + SIGPIPE : code;
  std::fprintf(stderr, "cairn%s%s: the answer could not be written to standard output%s%s\n",
               call.verb.empty() ? "" : " ", call.verb.c_str(), error != 0 ? ": " : "",
               error != 0 ? std::strerror(error) : "");
  return answered ? static_cast<int>(cairn::cli::kFailure) : code;
}

// Memory that runs out is an error of who asks for it, but of a stack that cannot grow there is only a signal: what the
// deepest calls take is asked for while there is plenty. One byte is touched, at its far end.
[[gnu::noinline]] void ReserveStack() {
  [[maybe_unused]] volatile char deep[1 << 20];
  deep[0] = 0;
}

}  // namespace

int main(int argc, char** argv) {
  ReserveStack();
  FillStandardStreams();
  std::set_terminate(EndInOrder);
  setenv("GRPC_VERBOSITY", "NONE", /*overwrite=*/0);  // what goes wrong is in the answers
  std::signal(SIGXFSZ, SIG_IGN);                      // writing beyond the limit is an error like a full disk
  Call call;
  int code = cairn::cli::kFailure;
  absl::Status status = cairn::Guarded([&] {
    cv::setNumThreads(1);  // OpenCV's threads fight ours
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
    spdlog::set_default_logger(spdlog::stderr_color_mt("cairn"));
    spdlog::set_pattern("%^%l%$: %v");
    call.arguments = Arguments(argc, argv);
    call.json = std::find(call.arguments.begin(), call.arguments.end(), "--json") != call.arguments.end();
    code = ParseAndRun(&call);
    return absl::OkStatus();
  });
  if (!status.ok()) {
    status = cairn::Guarded([&] {
      code = cairn::cli::Fail(call.verb, status, call.json);
      return absl::OkStatus();
    });
    if (!status.ok()) std::fputs("cairn: out of memory\n", stderr);
  }
  return CloseOutput(call, code);
}

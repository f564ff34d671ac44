#include "cli/bench_follow.h"

#include <chrono>
#include <cstdio>
#include <iostream>
#include <memory>
#include <string>

#include "cli/server_option.h"
#include "client/remote/followed_map.h"
#include "store/digest.h"

namespace cairn::cli {
namespace {

using Clock = std::chrono::steady_clock;

struct BenchFollowOptions {
  ServerChoice server;
  std::string map;
  bool away = false;
  bool json = false;
};

// What came to make the copy newer.
struct CatchUp {
  Revision from = 0, to = 0;
  client::FollowedMap::Traffic traffic;
  double elapsed_s = 0.0;
};

double SecondsSince(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

// Lets the connection go until there is a line to be read, and then goes on to where the server is.
absl::StatusOr<CatchUp> GoAwayAndComeBack(const BenchFollowOptions& options, client::RemoteMapService& service,
                                          client::FollowedMap& copy) {
  copy.Disconnect();
  CatchUp caught;
  caught.from = copy.view()->revision();
  const client::FollowedMap::Traffic before = copy.traffic();
  std::fprintf(stderr, "away at revision %llu: press return to come back\n",
               static_cast<unsigned long long>(caught.from));
  std::string line;
  std::getline(std::cin, line);
  CAIRN_ASSIGN_OR_RETURN(const api::MapDescription now, service.Describe(options.map));
  const Clock::time_point begin = Clock::now();
  copy.Reconnect();
  if (!copy.WaitFor(now.summary.revision, begin + std::chrono::seconds(60))) {
    return absl::DeadlineExceededError(
        absl::StrCat("revision ", now.summary.revision, " has not come within 60 s: ", copy.problem().message()));
  }
  caught.elapsed_s = SecondsSince(begin);
  caught.to = copy.view()->revision();
  caught.traffic = copy.traffic();
  caught.traffic.views -= before.views;
  caught.traffic.changes -= before.changes;
  caught.traffic.bytes -= before.bytes;
  return caught;
}

void Print(const BenchFollowOptions& options, const CatchUp& first, const CatchUp* later, const map::Snapshot& map) {
  const std::string digest = store::ContentDigest(map);
  if (options.json) {
    const auto json_of = [](const CatchUp& caught) {
      return nlohmann::ordered_json{{"from_revision", caught.from},  {"to_revision", caught.to},
                                    {"views", caught.traffic.views}, {"changes", caught.traffic.changes},
                                    {"bytes", caught.traffic.bytes}, {"elapsed_s", caught.elapsed_s}};
    };
    nlohmann::ordered_json json = {{"map", options.map}, {"view", json_of(first)}};
    if (later != nullptr) json["catch_up"] = json_of(*later);
    json.update({{"revision", map.revision()}, {"keyframes", map.keyframes().size()}, {"digest", digest}});
    PrintJson(json);
    return;
  }
  const auto print = [](const char* what, const CatchUp& caught) {
    std::printf("%s: to revision %llu, %.1f kB in %.2f s\n", what, static_cast<unsigned long long>(caught.to),
                1e-3 * static_cast<double>(caught.traffic.bytes), caught.elapsed_s);
  };
  print("the whole map", first);
  if (later != nullptr) print("what had changed since", *later);
  std::printf("  content digest %s at revision %llu\n", digest.c_str(),
              static_cast<unsigned long long>(map.revision()));
}

absl::Status BenchFollow(const BenchFollowOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::RemoteMapService> service, ConnectTo(options.server));
  const Clock::time_point begin = Clock::now();
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<client::FollowedMap> copy, service->CopyOf(options.map));
  const CatchUp first{0, copy->view()->revision(), copy->traffic(), SecondsSince(begin)};
  if (!options.away) {
    Print(options, first, nullptr, copy->view()->map());
    return absl::OkStatus();
  }
  CAIRN_ASSIGN_OR_RETURN(const CatchUp later, GoAwayAndComeBack(options, *service, *copy));
  Print(options, first, &later, copy->view()->map());
  return absl::OkStatus();
}

}  // namespace

void AddBenchFollowCommand(const CLI::App& app, CLI::App* bench, Action* action) {
  CLI::App* verb = bench->add_subcommand("follow", "A cairnd: bytes and time to have a copy of a map, and to catch up");
  auto options = std::make_shared<BenchFollowOptions>();
  verb->add_option("--map", options->map, "Name of the map at the server")->required();
  verb->add_flag("--away", options->away,
                 "Once the map is there, let the connection go until a line is entered, and then catch up");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "The digest is that of `cairn info --digest` of the file at the same revision.\n"
      "Example:\n"
      "  cairn --server localhost:7878 bench follow --map office");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      if (options->server.empty())
        return FailUsage("bench", "name the server: cairn --server HOST:PORT bench follow", options->json);
      const absl::Status status = BenchFollow(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("bench", status, options->json);
    };
  });
}

}  // namespace cairn::cli

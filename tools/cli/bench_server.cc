#include "cli/bench_server.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <memory>
#include <mutex>
#include <vector>

#include "base/guarded.h"
#include "cli/input_options.h"
#include "cli/sample_statistics.h"
#include "cli/server_option.h"

namespace cairn::cli {
namespace {

using Clock = std::chrono::steady_clock;

struct BenchServerOptions {
  InputOptions input;
  ServerChoice server;
  std::string map;
  int clients = 1;
  int count = 200;
  bool json = false;
};

// What all clients have found.
struct Tally {
  std::mutex mutex;
  SampleReservoir latency_ms;  // from the call to its answer
  SampleReservoir server_ms;   // of these, undistortion, features and locating at the server
  std::int64_t localized = 0;
  std::int64_t refused = 0;  // too many waited already
  absl::Status error;        // the first other one
};

constexpr std::size_t kMaxImages = 500;

absl::StatusOr<std::vector<cv::Mat>> ReadImages(io::FrameSource& source) {
  std::vector<cv::Mat> images;
  while (images.size() < kMaxImages) {
    CAIRN_ASSIGN_OR_RETURN(const std::optional<io::SourceFrame> frame, source.Next());
    if (!frame) break;
    if (frame->status.ok()) images.push_back(frame->gray);
  }
  if (images.empty()) return absl::DataLossError("no image of the sequence could be used");
  return images;
}

// A client with a connection of its own; clients share the images out among them until all calls are made.
void Ask(const BenchServerOptions& options, const std::vector<cv::Mat>& images, const Camera& camera,
         std::atomic<int>* next, Tally* tally) {
  const auto service = ConnectTo(options.server);
  if (!service.ok()) {
    const std::lock_guard lock(tally->mutex);
    tally->error.Update(service.status());
    return;
  }
  for (int i = (*next)++; i < options.count; i = (*next)++) {
    const Clock::time_point begin = Clock::now();
    const auto answer =
        (*service)->Localize(options.map, {images[static_cast<std::size_t>(i) % images.size()], camera, 0});
    const double ms = std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
    const std::lock_guard lock(tally->mutex);
    if (absl::IsResourceExhausted(answer.status())) {
      ++tally->refused;
    } else if (!answer.ok()) {
      tally->error.Update(answer.status());
      return;
    } else {
      tally->latency_ms.Add(static_cast<float>(ms));
      tally->server_ms.Add(static_cast<float>(answer->extract_ms + answer->locate_ms));
      tally->localized += answer->localized ? 1 : 0;
    }
  }
}

void PrintTally(const BenchServerOptions& options, const Tally& tally, double elapsed_s) {
  const double rate = static_cast<double>(tally.latency_ms.count()) / elapsed_s;
  if (options.json) {
    PrintJson({{"map", options.map},
               {"clients", options.clients},
               {"answers", tally.latency_ms.count()},
               {"localized", tally.localized},
               {"refused", tally.refused},
               {"answers_per_s", rate},
               {"latency_ms", SampleStatistics(tally.latency_ms)},
               {"server_ms", SampleStatistics(tally.server_ms)}});
    return;
  }
  std::printf("%lld images by %d clients: %.1f per second, %lld located, %lld refused\n",
              static_cast<long long>(tally.latency_ms.count()), options.clients, rate,
              static_cast<long long>(tally.localized), static_cast<long long>(tally.refused));
  std::printf("  at the client %.1f ms median, %.1f p99; of these %.1f and %.1f at the server's work\n",
              tally.latency_ms.Percentile(0.5), tally.latency_ms.Percentile(0.99), tally.server_ms.Percentile(0.5),
              tally.server_ms.Percentile(0.99));
}

absl::Status BenchServer(const BenchServerOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<io::FrameSource> source, OpenInput(options.input, "bench"));
  const Camera camera = source->info().camera;
  CAIRN_ASSIGN_OR_RETURN(const std::vector<cv::Mat> images, ReadImages(*source));
  // The first call opens the map.
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::RemoteMapService> service, ConnectTo(options.server));
  CAIRN_RETURN_IF_ERROR(service->Localize(options.map, {images[0], camera, 0}).status());
  Tally tally;
  std::atomic<int> next = 0;
  const Clock::time_point begin = Clock::now();
  RunInThreads(options.clients, [&] { Ask(options, images, camera, &next, &tally); });
  const double elapsed_s = std::chrono::duration<double>(Clock::now() - begin).count();
  CAIRN_RETURN_IF_ERROR(tally.error);
  PrintTally(options, tally, elapsed_s);
  return absl::OkStatus();
}

}  // namespace

void AddBenchServerCommand(const CLI::App& app, CLI::App* bench, Action* action) {
  CLI::App* verb = bench->add_subcommand(
      "server", "A cairnd: latency at the client and answers per second, locating the images of a sequence");
  auto options = std::make_shared<BenchServerOptions>();
  AddInputOptions(verb, &options->input);
  verb->add_option("--map", options->map, "Name of the map at the server")->required();
  verb->add_option("--clients", options->clients, "That ask at the same time, each over a connection of its own")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  verb->add_option("--count", options->count, "Images to locate in all")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "All images (up to 500) are decoded, and the map is open, before the clock starts.\n"
      "Example:\n"
      "  cairn --server localhost:7878 bench server visit_2 --map office --clients 4");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      if (options->server.empty())
        return FailUsage("bench", "name the server: cairn --server HOST:PORT bench server", options->json);
      const absl::Status status = BenchServer(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("bench", status, options->json);
    };
  });
}

}  // namespace cairn::cli

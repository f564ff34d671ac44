#include "cli/bench_server.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "base/files.h"
#include "base/guarded.h"
#include "cli/input_options.h"
#include "cli/sample_statistics.h"
#include "cli/served_photo.h"
#include "cli/server_option.h"
#include "client/query_image.h"

namespace cairn::cli {
namespace {

using Clock = std::chrono::steady_clock;

struct BenchServerOptions {
  InputOptions input;
  ServerChoice server;
  std::string map;
  std::string send = "image";
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
constexpr std::uint64_t kMaxFileBytes = 64 << 20;

// An image, and the file that it was read from.
struct Photo {
  cv::Mat image;
  std::string file;
};

absl::StatusOr<std::vector<Photo>> ReadPhotos(io::FrameSource& source, bool with_files) {
  std::vector<Photo> photos;
  while (photos.size() < kMaxImages) {
    CAIRN_ASSIGN_OR_RETURN(const std::optional<io::SourceFrame> frame, source.Next());
    if (!frame) break;
    if (!frame->status.ok()) continue;
    photos.push_back({frame->gray, ""});
    if (!with_files) continue;
    CAIRN_ASSIGN_OR_RETURN(photos.back().file, ReadWholeFile(frame->path, kMaxFileBytes));
  }
  if (photos.empty()) return absl::DataLossError("no image of the sequence could be used");
  return photos;
}

using Locate = std::function<absl::StatusOr<api::LocalizeAnswer>(const Photo& photo)>;

// A client with a connection of its own, which sends what the options say.
absl::StatusOr<Locate> NewClient(const BenchServerOptions& options, const Camera& camera) {
  if (options.send == "file") {
    CAIRN_ASSIGN_OR_RETURN(const client::RemoteOptions remote, RemoteOptionsOf(options.server));
    CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<PhotoAsker> asker, NewPhotoAsker(remote));
    return Locate([=](const Photo& photo) { return asker->Ask(options.map, photo.file, camera); });
  }
  CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<client::RemoteMapService> service, ConnectTo(options.server));
  return Locate([=](const Photo& photo) { return service->Localize(options.map, {photo.image, camera, 0}); });
}

// Clients share the images out among them until all calls are made.
void Ask(const BenchServerOptions& options, const std::vector<Photo>& photos, const Camera& camera,
         std::atomic<int>* next, Tally* tally) {
  const auto locate = NewClient(options, camera);
  if (!locate.ok()) {
    const std::lock_guard lock(tally->mutex);
    tally->error.Update(locate.status());
    return;
  }
  for (int i = (*next)++; i < options.count; i = (*next)++) {
    const Clock::time_point begin = Clock::now();
    const auto answer = (*locate)(photos[static_cast<std::size_t>(i) % photos.size()]);
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

// Of a request, on average.
absl::StatusOr<double> RequestBytesOf(const BenchServerOptions& options, const std::vector<Photo>& photos,
                                      const Camera& camera, client::RemoteMapService& service) {
  CAIRN_ASSIGN_OR_RETURN(const api::MapDescription map, service.Describe(options.map));
  CAIRN_ASSIGN_OR_RETURN(const image::Undistorter undistorter, image::Undistorter::Create(camera));
  std::int64_t bytes = 0;
  for (const Photo& photo : photos) {
    api::LocalizeQuery query{photo.image, camera, 0};
    if (options.send == "file") {
      bytes += RequestBytes(photo.file, camera);
      continue;
    }
    if (options.send == "features") {
      CAIRN_ASSIGN_OR_RETURN(const cv::Mat image, undistorter.Undistort(photo.image));
      CAIRN_ASSIGN_OR_RETURN(query.features, client::ExtractAt(map.orb, undistorter.pinhole(), image, 1.0, 0));
    }
    bytes += RequestBytes(query);
  }
  return static_cast<double>(bytes) / static_cast<double>(photos.size());
}

void PrintTally(const BenchServerOptions& options, const Tally& tally, double elapsed_s, double request_bytes) {
  const double rate = static_cast<double>(tally.latency_ms.count()) / elapsed_s;
  if (options.json) {
    PrintJson({{"map", options.map},
               {"clients", options.clients},
               {"sent", options.send},
               {"request_bytes", request_bytes},
               {"answers", tally.latency_ms.count()},
               {"localized", tally.localized},
               {"refused", tally.refused},
               {"answers_per_s", rate},
               {"latency_ms", SampleStatistics(tally.latency_ms)},
               {"server_ms", SampleStatistics(tally.server_ms)}});
    return;
  }
  std::printf("%lld images by %d clients: %.1f per second, %lld located, %lld refused; %.0f kB each\n",
              static_cast<long long>(tally.latency_ms.count()), options.clients, rate,
              static_cast<long long>(tally.localized), static_cast<long long>(tally.refused), 1e-3 * request_bytes);
  std::printf("  at the client %.1f ms median, %.1f p99; of these %.1f and %.1f at the server's work\n",
              tally.latency_ms.Percentile(0.5), tally.latency_ms.Percentile(0.99), tally.server_ms.Percentile(0.5),
              tally.server_ms.Percentile(0.99));
}

absl::Status BenchServer(const BenchServerOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<io::FrameSource> source, OpenInput(options.input, "bench"));
  const Camera camera = source->info().camera;
  CAIRN_ASSIGN_OR_RETURN(const std::vector<Photo> photos, ReadPhotos(*source, options.send == "file"));
  // The first call opens the map.
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::RemoteMapService> service, ConnectTo(options.server));
  CAIRN_RETURN_IF_ERROR(service->Localize(options.map, {photos[0].image, camera, 0}).status());
  CAIRN_ASSIGN_OR_RETURN(const double request_bytes, RequestBytesOf(options, photos, camera, *service));
  Tally tally;
  std::atomic<int> next = 0;
  const Clock::time_point begin = Clock::now();
  RunInThreads(options.clients, [&] { Ask(options, photos, camera, &next, &tally); });
  const double elapsed_s = std::chrono::duration<double>(Clock::now() - begin).count();
  CAIRN_RETURN_IF_ERROR(tally.error);
  PrintTally(options, tally, elapsed_s, request_bytes);
  return absl::OkStatus();
}

}  // namespace

void AddBenchServerCommand(const CLI::App& app, CLI::App* bench, Action* action) {
  CLI::App* verb = bench->add_subcommand(
      "server", "A cairnd: latency at the client and answers per second, locating the images of a sequence");
  auto options = std::make_shared<BenchServerOptions>();
  AddInputOptions(verb, &options->input);
  verb->add_option("--map", options->map, "Name of the map at the server")->required();
  verb->add_option(
          "--send", options->send,
          "Gray pixels, features that are extracted here, or the files of the sequence as they are (PNG, JPEG)")
      ->check(CLI::IsMember({"image", "features", "file"}))
      ->default_str("image");
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
    options->server.send_features = options->send == "features";
    *action = [=] {
      if (options->server.empty())
        return FailUsage("bench", "name the server: cairn --server HOST:PORT bench server", options->json);
      const absl::Status status = BenchServer(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("bench", status, options->json);
    };
  });
}

}  // namespace cairn::cli

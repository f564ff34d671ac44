// A C++ program against the installed headers alone: no Eigen, no OpenCV. usage: robot MAP PHOTO.pgm
#include <cairn/answers.h>
#include <cairn/call_options.h>
#include <cairn/camera.h>
#include <cairn/image_view.h>
#include <cairn/localizer.h>
#include <cairn/map.h>
#include <cairn/pose.h>
#include <cairn/status.h>
#include <cairn/tracker.h>
#include <cairn/version.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <iterator>
#include <string>
#include <thread>
#include <vector>

#if defined(EIGEN_WORLD_VERSION) || defined(CV_VERSION)
#error "a public header includes Eigen or OpenCV"
#endif

namespace {

#define CHECK(condition)                                                         \
  if (!(condition)) {                                                            \
    std::cerr << "robot: line " << __LINE__ << ": " << #condition << " fails\n"; \
    return 1;                                                                    \
  }

int Run(const char* path, const cairn::ImageView& image) {
  CHECK(cairn::Map::Open("/no/such/map.cairn").status().code() == absl::StatusCode::kNotFound);
  CHECK(cairn::Map::Open("").status().code() != absl::StatusCode::kOk);
  const absl::StatusOr<cairn::Map> map = cairn::Map::Open(path);
  if (!map.ok()) std::cerr << map.status() << "\n";
  CHECK(map.ok());
  const absl::StatusOr<cairn::MapInfo> info = map->Info();
  CHECK(info.ok() && info->cameras.size() == 1 && info->keyframes == 10);

  auto localizer = map->NewLocalizer();
  CHECK(localizer.ok());
  const cairn::LocalizeQuery query{image, info->cameras[0].camera};
  std::vector<std::thread> threads;
  std::vector<absl::StatusOr<cairn::LocalizeAnswer>> answers(3, absl::UnknownError("not run"));
  for (auto& answer : answers) threads.emplace_back([&] { answer = localizer->Localize(query); });
  for (std::thread& thread : threads) thread.join();
  for (const auto& answer : answers) {
    CHECK(answer.ok() && answer->localized);
    CHECK(answer->stage == cairn::LocalizeStage::kDone && answer->map_id == info->id);
    CHECK(std::abs(answer->map_from_camera.translation[0] - 0.2) < 0.02);
    CHECK(std::abs(answer->world_from_camera.translation[0] - 10.4) < 0.04);
    const double sigma = cairn::PositionSigma(answer->map_from_camera, answer->covariance);
    CHECK(sigma > 0.0 && sigma < 0.02);
  }
  CHECK(localizer->Localize({}).status().code() == absl::StatusCode::kInvalidArgument);
  cairn::Cancellation cancellation;
  cancellation.Cancel();
  cairn::CallOptions cancelled;
  cancelled.cancellation = &cancellation;
  CHECK(localizer->Localize(query, cancelled).status().code() == absl::StatusCode::kCancelled);
  CHECK(map->Refresh().ok() && !*map->Refresh());
  absl::StatusOr<cairn::Tracker> tracker = map->NewTracker(info->cameras[0].camera);
  CHECK(tracker.ok());
  const absl::StatusOr<cairn::TrackAnswer> tracked = tracker->Track(image, 1);
  CHECK(tracked.ok() && tracked->state == cairn::TrackState::kLocated);
  std::cout << "robot: all is well with cairn " << CAIRN_VERSION << "\n";
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  std::ifstream file(argv[2], std::ios::binary);
  std::string magic;
  int width = 0, height = 0, brightest = 0;
  file >> magic >> width >> height >> brightest;
  file.get();
  const std::vector<char> pixels((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  if (magic != "P5" || pixels.size() != static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) return 2;
  cairn::ImageView image;
  image.data = reinterpret_cast<const std::uint8_t*>(pixels.data());
  image.width_px = width;
  image.height_px = height;
  return Run(argv[1], image);
}

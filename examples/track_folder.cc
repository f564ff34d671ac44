// A pose for every image of a folder, in the order of their names, by the camera that the map was made with:
//
//   track_folder office.cairn images [RATE_HZ]
//
// Lines are "t tx ty tz qx qy qz qw" (TUM format), in the world if the map is aligned; then what is known of it.
// Exit codes: 0 any image has a pose, 4 none has, 1 failure, 2 usage.
#include <cairn/conversions.h>
#include <cairn/map.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

namespace {

int Fail(const absl::Status& status) {
  std::fprintf(stderr, "track_folder: %s\n", status.ToString().c_str());
  return 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3 && argc != 4) {
    std::fprintf(stderr, "usage: track_folder MAP FOLDER [RATE_HZ]\n");
    return 2;
  }
  const double rate_hz = argc == 4 ? std::atof(argv[3]) : 30.0;
  std::vector<std::filesystem::path> paths;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(argv[2], error)) paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());

  const absl::StatusOr<cairn::Map> map = cairn::Map::Open(argv[1]);
  if (!map.ok()) return Fail(map.status());
  const absl::StatusOr<cairn::MapInfo> info = map->Info();
  if (!info.ok()) return Fail(info.status());
  if (info->cameras.empty()) return Fail(absl::FailedPreconditionError("the map is empty"));
  cairn::TrackerOptions options;
  options.wait_for_matches = true;  // the images come faster than from a camera
  absl::StatusOr<cairn::Tracker> tracker = map->NewTracker(info->cameras.front().camera, options);
  if (!tracker.ok()) return Fail(tracker.status());

  bool found = false;
  for (std::size_t i = 0; i < paths.size(); ++i) {
    const cv::Mat pixels = cv::imread(paths[i].string(), cv::IMREAD_GRAYSCALE);
    const absl::StatusOr<cairn::ImageView> image = cairn::ViewOf(pixels);
    if (!image.ok()) continue;  // no image
    const double time_s = static_cast<double>(i + 1) / rate_hz;
    const auto answer = tracker->Track(*image, static_cast<std::int64_t>(time_s * 1e9));
    if (!answer.ok()) return Fail(answer.status());
    if (answer->state == cairn::TrackState::kLost) {
      std::printf("# %.6f lost: %s\n", time_s, answer->reason.c_str());
      continue;
    }
    found = true;
    const auto& t = answer->world_from_camera.translation;
    const auto& q = answer->world_from_camera.rotation_xyzw;
    const double sigma = answer->world_per_map * cairn::PositionSigma(answer->map_from_camera, answer->covariance);
    std::printf("%.6f %.6f %.6f %.6f %.6f %.6f %.6f %.6f # %s +- %.4f component %u\n", time_s, t[0], t[1], t[2], q[0],
                q[1], q[2], q[3], cairn::TrackStateName(answer->state), sigma, answer->component);
  }
  return found ? 0 : 4;
}

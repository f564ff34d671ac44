// Looks for a photo in a map that another process is writing, until it is found:
//
//   follow_growing_map office.cairn photo.jpg [SECONDS]
//
// `cairn run` or the daemon may be adding to the map meanwhile; a robot would ask with its newest image instead.
// Exit codes: 0 located, 4 not located in time, 1 failure, 2 usage.
#include <cairn/conversions.h>
#include <cairn/map.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <thread>

namespace {

int Fail(const absl::Status& status) {
  std::fprintf(stderr, "follow_growing_map: %s\n", status.ToString().c_str());
  return 1;
}

// Once in the revision that the map is at. False: not located.
absl::StatusOr<bool> Look(const cairn::Map& map, const cairn::Localizer& localizer, const cairn::ImageView& image) {
  const absl::StatusOr<cairn::MapInfo> info = map.Info();
  if (!info.ok()) return info.status();
  std::printf("revision %llu: %lld keyframes, ", static_cast<unsigned long long>(info->revision),
              static_cast<long long>(info->keyframes));
  if (info->cameras.empty()) {
    std::printf("still empty\n");
    return false;
  }
  cairn::LocalizeQuery query;
  query.image = image;
  query.camera = info->cameras.front().camera;
  const absl::StatusOr<cairn::LocalizeAnswer> answer = localizer.Localize(query);
  if (!answer.ok()) return answer.status();
  const auto& at = answer->world_from_camera.translation;
  if (!answer->localized) std::printf("not located: %s\n", answer->reason.c_str());
  if (answer->localized) std::printf("located at %.4f %.4f %.4f\n", at[0], at[1], at[2]);
  return answer->localized;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3 && argc != 4) {
    std::fprintf(stderr, "usage: follow_growing_map MAP PHOTO [SECONDS]\n");
    return 2;
  }
  const cv::Mat pixels = cv::imread(argv[2], cv::IMREAD_GRAYSCALE);
  const absl::StatusOr<cairn::ImageView> image = cairn::ViewOf(pixels);
  if (!image.ok()) return Fail(absl::InvalidArgumentError(std::string(argv[2]) + ": no image can be read from it"));
  const absl::StatusOr<cairn::Map> map = cairn::Map::Open(argv[1]);
  if (!map.ok()) return Fail(map.status());
  const absl::StatusOr<cairn::Localizer> localizer = map->NewLocalizer();
  if (!localizer.ok()) return Fail(localizer.status());

  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(argc == 4 ? std::atoi(argv[3]) : 60);
  absl::StatusOr<bool> newer = true;  // than what was looked at
  while (std::chrono::steady_clock::now() < end) {
    if (!newer.ok()) return Fail(newer.status());
    const absl::StatusOr<bool> found = *newer ? Look(*map, *localizer, *image) : false;
    if (!found.ok()) return Fail(found.status());
    if (*found) return 0;
    std::fflush(stdout);
    std::this_thread::sleep_for(std::chrono::milliseconds(100));  // a robot has its next image now
    newer = map->Refresh();
  }
  return 4;
}

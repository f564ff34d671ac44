// Where a photo was taken:
//
//   localize_photo office.cairn photo.jpg                   by the camera that the map was made with
//   localize_photo office.cairn photo.jpg FX FY CX CY       by another one, without distortion, in pixels
//
// Exit codes: 0 located, 4 not located, 1 failure, 2 usage.
#include <cairn/conversions.h>
#include <cairn/map.h>

#include <cstdio>
#include <cstdlib>
#include <opencv2/imgcodecs.hpp>
#include <string>

namespace {

int Fail(const absl::Status& status) {
  std::fprintf(stderr, "localize_photo: %s\n", status.ToString().c_str());
  return 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3 && argc != 7) {
    std::fprintf(stderr, "usage: localize_photo MAP PHOTO [FX FY CX CY]\n");
    return 2;
  }
  const absl::StatusOr<cairn::Map> map = cairn::Map::Open(argv[1]);
  if (!map.ok()) return Fail(map.status());
  const absl::StatusOr<cairn::MapInfo> info = map->Info();
  if (!info.ok()) return Fail(info.status());
  const absl::StatusOr<cairn::Localizer> localizer = map->NewLocalizer();
  if (!localizer.ok()) return Fail(localizer.status());

  const cv::Mat pixels = cv::imread(argv[2], cv::IMREAD_COLOR);
  const absl::StatusOr<cairn::ImageView> image = cairn::ViewOf(pixels);
  if (!image.ok()) return Fail(absl::InvalidArgumentError(std::string(argv[2]) + ": no image can be read from it"));
  cairn::LocalizeQuery query;
  query.image = *image;
  if (argc == 7) {
    query.camera.width_px = pixels.cols;
    query.camera.height_px = pixels.rows;
    query.camera.fx_px = std::atof(argv[3]);
    query.camera.fy_px = std::atof(argv[4]);
    query.camera.cx_px = std::atof(argv[5]);
    query.camera.cy_px = std::atof(argv[6]);
  } else if (!info->cameras.empty()) {
    query.camera = info->cameras.front().camera;
  }

  const auto answer = localizer->Localize(query, cairn::CallOptions::Within(std::chrono::seconds(10)));
  if (!answer.ok()) return Fail(answer.status());
  if (!answer->localized) {
    std::printf("not located at stage \"%s\": %s\n", cairn::LocalizeStageName(answer->stage), answer->reason.c_str());
    return 4;
  }
  // In metres if the map is aligned to the world, else in its own units.
  const cairn::Pose& pose = answer->world_from_camera;
  const double sigma = answer->world_per_map * cairn::PositionSigma(answer->map_from_camera, answer->covariance);
  std::printf("%.4f %.4f %.4f %s, +- %.4f, in component %u of revision %llu\n", pose.translation[0],
              pose.translation[1], pose.translation[2], answer->world_is_metric ? "m" : "map units", sigma,
              answer->component, static_cast<unsigned long long>(answer->revision));
  const Eigen::Vector3d looks_along = cairn::ToEigen(pose).linear().col(2);
  std::printf("looks along %.4f %.4f %.4f\n", looks_along.x(), looks_along.y(), looks_along.z());
  return 0;
}

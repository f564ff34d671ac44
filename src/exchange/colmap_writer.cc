#include <cstring>
#include <filesystem>
#include <string>

#include "absl/strings/str_format.h"
#include "base/files.h"
#include "exchange/colmap.h"
#include "exchange/colmap_format.h"

namespace cairn::exchange {
namespace {

using colmap::kNoPoint;
using colmap::kNoPointBinary;
using colmap::kPixelCentre;

std::string CamerasText(const Reconstruction& model) {
  std::string text = absl::StrCat(
      "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
      "# Number of cameras: ",
      model.cameras.size(), "\n");
  for (const auto& [id, c] : model.cameras) {
    absl::StrAppendFormat(&text, "%u PINHOLE %d %d %.17g %.17g %.17g %.17g\n", id, c.width_px, c.height_px, c.fx_px,
                          c.fy_px, c.cx_px + kPixelCentre, c.cy_px + kPixelCentre);
  }
  return text;
}

std::string ImagesText(const Reconstruction& model) {
  std::string text = absl::StrCat(
      "# Image list with two lines of data per image:\n"
      "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n#   POINTS2D[] as (X, Y, POINT3D_ID)\n"
      "# Number of images: ",
      model.images.size(), "\n");
  for (const ModelImage& image : model.images) {
    const Quaterniond& q = image.camera_from_world.rotation();
    const Vector3d& t = image.camera_from_world.translation();
    absl::StrAppendFormat(&text, "%u %.17g %.17g %.17g %.17g %.17g %.17g %.17g %u %s\n", image.id, q.w(), q.x(), q.y(),
                          q.z(), t.x(), t.y(), t.z(), image.camera, image.name);
    for (std::size_t i = 0; i < image.keypoints.size(); ++i) {
      absl::StrAppendFormat(&text, "%s%.9g %.9g %d", i > 0 ? " " : "", image.keypoints[i].x() + kPixelCentre,
                            image.keypoints[i].y() + kPixelCentre,
                            image.points[i] != 0 ? std::int64_t{image.points[i]} : kNoPoint);
    }
    text += "\n";
  }
  return text;
}

std::string PointsText(const Reconstruction& model) {
  std::string text = absl::StrCat(
      "# 3D point list with one line of data per point:\n"
      "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n# Number of points: ",
      model.points.size(), "\n");
  for (const ModelPoint& point : model.points) {
    absl::StrAppendFormat(&text, "%u %.17g %.17g %.17g %d %d %d %.9g", point.id, point.position.x(), point.position.y(),
                          point.position.z(), point.red, point.green, point.blue, point.error_mean_px);
    for (const ModelObservation& o : point.track) absl::StrAppend(&text, " ", o.image, " ", o.keypoint);
    text += "\n";
  }
  return text;
}

template <class T>
void Put(std::string* out, T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  out->append(bytes, sizeof(T));
}

std::string CamerasBinary(const Reconstruction& model) {
  std::string out;
  Put(&out, std::uint64_t{model.cameras.size()});
  for (const auto& [id, camera] : model.cameras) {
    Put(&out, id);
    Put(&out, std::int32_t{1});
    Put(&out, static_cast<std::uint64_t>(camera.width_px));
    Put(&out, static_cast<std::uint64_t>(camera.height_px));
    for (const double p : {camera.fx_px, camera.fy_px, camera.cx_px + kPixelCentre, camera.cy_px + kPixelCentre}) {
      Put(&out, p);
    }
  }
  return out;
}

std::string ImagesBinary(const Reconstruction& model) {
  std::string out;
  Put(&out, std::uint64_t{model.images.size()});
  for (const ModelImage& image : model.images) {
    const Quaterniond& q = image.camera_from_world.rotation();
    const Vector3d& t = image.camera_from_world.translation();
    Put(&out, image.id);
    for (const double value : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) Put(&out, value);
    Put(&out, image.camera);
    out.append(image.name).push_back('\0');
    Put(&out, std::uint64_t{image.keypoints.size()});
    for (std::size_t i = 0; i < image.keypoints.size(); ++i) {
      Put(&out, image.keypoints[i].x() + kPixelCentre);
      Put(&out, image.keypoints[i].y() + kPixelCentre);
      Put(&out, image.points[i] != 0 ? std::uint64_t{image.points[i]} : kNoPointBinary);
    }
  }
  return out;
}

std::string PointsBinary(const Reconstruction& model) {
  std::string out;
  Put(&out, std::uint64_t{model.points.size()});
  for (const ModelPoint& point : model.points) {
    Put(&out, std::uint64_t{point.id});
    for (int i = 0; i < 3; ++i) Put(&out, point.position[i]);
    for (const std::uint8_t value : {point.red, point.green, point.blue}) Put(&out, value);
    Put(&out, point.error_mean_px);
    Put(&out, std::uint64_t{point.track.size()});
    for (const ModelObservation& observation : point.track) {
      Put(&out, observation.image);
      Put(&out, observation.keypoint);
    }
  }
  return out;
}

}  // namespace

absl::Status WriteColmap(const Reconstruction& model, const std::string& folder, ColmapFormat format, bool overwrite) {
  for (const auto& [id, camera] : model.cameras) {
    if (!camera.IsUndistorted()) return absl::InvalidArgumentError(absl::StrCat("camera ", id, " is no pinhole"));
  }
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) return absl::NotFoundError(absl::StrCat(folder, ": ", error.message()));
  const bool text = format == ColmapFormat::kText;
  const std::pair<const char*, std::string> files[] = {
      {text ? "cameras.txt" : "cameras.bin", text ? CamerasText(model) : CamerasBinary(model)},
      {text ? "images.txt" : "images.bin", text ? ImagesText(model) : ImagesBinary(model)},
      {text ? "points3D.txt" : "points3D.bin", text ? PointsText(model) : PointsBinary(model)}};
  for (const auto& [name, contents] : files) {
    CAIRN_RETURN_IF_ERROR(WriteFileAtomically(absl::StrCat(folder, "/", name), contents, overwrite));
  }
  return absl::OkStatus();
}

}  // namespace cairn::exchange

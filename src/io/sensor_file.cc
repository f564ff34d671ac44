#include "io/sensor_file.h"

#include "io/yaml_file.h"

namespace cairn::io {
namespace {

absl::StatusOr<CameraModel> ModelOf(const std::string& path, const YAML::Node& root) {
  if (root["camera_model"]) {
    CAIRN_ASSIGN_OR_RETURN(const std::string camera_model, YamlText(path, root, "camera_model"));
    if (camera_model != "pinhole") {
      return YamlError(
          path, root["camera_model"],
          absl::StrCat("camera_model `", camera_model, "` is not known, only pinhole; give the camera with --camera"));
    }
  }
  if (!root["distortion_model"]) return CameraModel::kPinhole;
  CAIRN_ASSIGN_OR_RETURN(const std::string name, YamlText(path, root, "distortion_model"));
  if (name == "radial-tangential" || name == "radtan" || name == "plumb_bob" || name == "rational_polynomial") {
    return CameraModel::kRadialTangential;
  }
  if (name == "equidistant" || name == "kannala-brandt") return CameraModel::kKannalaBrandt;
  if (name == "fov") return CameraModel::kFov;
  if (name == "none") return CameraModel::kPinhole;
  return YamlError(
      path, root["distortion_model"],
      absl::StrCat("distortion_model `", name, "` is not one of radial-tangential, equidistant, fov, none"));
}

}  // namespace

bool LooksLikeSensorFile(const YAML::Node& root) { return root["camera_model"] && root["intrinsics"]; }

absl::StatusOr<Camera> ReadSensorCamera(const std::string& path, const YAML::Node& root) {
  Camera camera;
  CAIRN_ASSIGN_OR_RETURN(camera.model, ModelOf(path, root));
  CAIRN_RETURN_IF_ERROR(YamlSize(path, root, "resolution", &camera.width_px, &camera.height_px));
  CAIRN_ASSIGN_OR_RETURN(const std::vector<double> intrinsics, YamlNumbers(path, root, "intrinsics"));
  if (intrinsics.size() != 4) return YamlError(path, root["intrinsics"], "`intrinsics` must be [fu, fv, cu, cv]");
  camera.fx_px = intrinsics[0];
  camera.fy_px = intrinsics[1];
  camera.cx_px = intrinsics[2];
  camera.cy_px = intrinsics[3];
  if (camera.model != CameraModel::kPinhole) {
    CAIRN_ASSIGN_OR_RETURN(camera.distortion, YamlNumbers(path, root, "distortion_coefficients"));
  }
  CAIRN_RETURN_IF_ERROR(Annotate(camera.Validate(), path));
  return camera;
}

}  // namespace cairn::io

#include "io/body_camera.h"

#include <filesystem>

#include "io/sequence_readers.h"
#include "io/yaml_file.h"

namespace cairn::io {

absl::StatusOr<std::optional<SE3>> FindBodyFromCamera(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const YAML::Node root, LoadYamlMap(path));
  const YAML::Node node = root["T_BS"];
  if (!node || !node.IsMap() || !node["data"]) return std::optional<SE3>();
  CAIRN_ASSIGN_OR_RETURN(const std::vector<double> data, YamlNumbers(path, node, "data"));
  if (data.size() != 16) return YamlError(path, node["data"], "T_BS must have 16 numbers, a 4x4 matrix");
  const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> m(data.data());
  const Matrix3d rotation = m.topLeftCorner<3, 3>();
  if ((rotation * rotation.transpose() - Matrix3d::Identity()).norm() > 1e-3 || rotation.determinant() < 0) {
    return YamlError(path, node["data"], "the upper left 3x3 part of T_BS is not a rotation");
  }
  return std::optional<SE3>(SE3(rotation, m.topRightCorner<3, 1>()));
}

absl::StatusOr<SE3> ReadBodyFromCamera(const std::string& sensor_path) {
  CAIRN_ASSIGN_OR_RETURN(const std::optional<SE3> body_from_camera, FindBodyFromCamera(sensor_path));
  if (!body_from_camera) {
    return absl::InvalidArgumentError(
        absl::StrCat(sensor_path, " has no T_BS with 16 numbers under `data`: where the camera sits on the body"));
  }
  return *body_from_camera;
}

std::optional<std::string> SensorBesideGroundtruth(const std::string& groundtruth_path) {
  const std::filesystem::path folder = std::filesystem::path(groundtruth_path).parent_path();
  const std::filesystem::path sensor =
      (folder.empty() ? std::filesystem::path(".") : folder) / ".." / "cam0" / "sensor.yaml";
  if (!IsFile(sensor)) return std::nullopt;
  return sensor.lexically_normal().string();
}

}  // namespace cairn::io

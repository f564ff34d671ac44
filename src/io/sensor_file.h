// The sensor.yaml of EuRoC / ASL folders, as far as it is about the camera: camera_model, resolution, intrinsics,
// distortion_model, distortion_coefficients. What else stands there is of no account here.
#pragma once

#include <yaml-cpp/yaml.h>

#include <string>

#include "base/status.h"
#include "geometry/camera.h"

namespace cairn::io {

bool LooksLikeSensorFile(const YAML::Node& root);

// InvalidArgument naming file, line and remedy.
absl::StatusOr<Camera> ReadSensorCamera(const std::string& path, const YAML::Node& root);

}  // namespace cairn::io

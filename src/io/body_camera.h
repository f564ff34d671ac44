// Where a camera sits on the body whose poses a recording gives: `T_BS` of the sensor.yaml files of EuRoC / ASL.
#pragma once

#include <optional>
#include <string>

#include "base/status.h"
#include "geometry/se3.h"

namespace cairn::io {

// body_from_camera; nothing if the file has no T_BS.
absl::StatusOr<std::optional<SE3>> FindBodyFromCamera(const std::string& sensor_path);

// The same, of a file that must have it. NotFound if there is no file, InvalidArgument if it holds no T_BS or one that
// is no transform; both name it.
absl::StatusOr<SE3> ReadBodyFromCamera(const std::string& sensor_path);

// The sensor.yaml of the first camera beside a ground truth file of such a recording: FOLDER/../cam0/sensor.yaml.
std::optional<std::string> SensorBesideGroundtruth(const std::string& groundtruth_path);

}  // namespace cairn::io

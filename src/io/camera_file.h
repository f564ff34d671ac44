// The camera.yaml files (docs/input.md); the sensor.yaml of EuRoC folders are read as well.
#pragma once

#include <string>

#include "base/status.h"
#include "geometry/camera.h"

namespace cairn::io {

struct CameraFile {
  Camera camera;
  double rate_hz = 0.0;  // nominal; 0: not said
};

// NotFound, or InvalidArgument naming file, line and remedy; unknown and repeated keys are errors.
absl::StatusOr<CameraFile> LoadCamera(const std::string& path);

// AlreadyExists if there is a file and not `overwrite`. Loading gives back equal numbers.
absl::Status SaveCamera(const std::string& path, const CameraFile& file, bool overwrite = false);

}  // namespace cairn::io

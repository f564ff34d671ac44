// Point clouds as PLY files (Turk, "The PLY polygon file format", 1994), for MeshLab, CloudCompare, Open3D.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "base/status.h"

namespace cairn::io {

struct ColoredPoint {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  std::uint8_t red = 255;
  std::uint8_t green = 255;
  std::uint8_t blue = 255;
};

// Binary little endian, positions as float. InvalidArgument for a position that is not finite; AlreadyExists if there
// is a file and not `overwrite`. `comment`: a line in the header; may be empty.
absl::Status WritePly(const std::string& path, const std::vector<ColoredPoint>& points, bool overwrite = false,
                      const std::string& comment = "");

}  // namespace cairn::io

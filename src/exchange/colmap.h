// COLMAP's sparse models: cameras, images and points3D, as text or binary (COLMAP's documentation, "Output format").
// COLMAP's pixel centres are at halves, ours at integers: half a pixel is added where files are written, and taken off
// where they are read.
#pragma once

#include <string>

#include "base/status.h"
#include "exchange/reconstruction.h"

namespace cairn::exchange {

enum class ColmapFormat { kText, kBinary };

// The three files in `folder`, which is made if it does not exist. Cameras must be pinholes. AlreadyExists if one of
// them is there and not `overwrite`.
absl::Status WriteColmap(const Reconstruction& model, const std::string& folder, ColmapFormat format, bool overwrite);

// Binary files are taken where there are both. Models of cameras: SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL,
// OPENCV, OPENCV_FISHEYE. Errors name the file, and the line or the entry: NotFound, DataLoss (truncated, a number that
// is none), InvalidArgument (a model that is not known, ids that lead nowhere).
absl::StatusOr<Reconstruction> ReadColmap(const std::string& folder);

}  // namespace cairn::exchange

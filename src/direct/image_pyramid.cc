#include "direct/image_pyramid.h"

#include <algorithm>
#include <cstring>
#include <new>

#include "direct/pyramid_kernel.h"

namespace cairn::direct {
namespace {

constexpr int kLineFloats = 16;  // of a cache line

}  // namespace

PyramidGeometry PyramidGeometry::Make(const Pinhole& full_camera, bool full_resolution, int max_levels,
                                      int min_level_pixels) {
  PyramidGeometry geometry;
  geometry.half = !full_resolution;
  geometry.camera[0] = full_resolution ? full_camera : full_camera.Half();
  geometry.levels = 1;
  while (geometry.levels < std::min(max_levels, kMaxLevels)) {
    const Pinhole next = geometry.camera[geometry.levels - 1].Half();
    if (next.width_px * next.height_px < min_level_pixels) break;
    geometry.camera[geometry.levels++] = next;
  }
  return geometry;
}

ImagePyramid::ImagePyramid(SimdLevel level) : kernels_(&PyramidKernelsFor(level)) {}

ImagePyramid::Buffer ImagePyramid::Allocate(std::size_t floats) {
  const std::size_t bytes = (floats * sizeof(float) + 63) / 64 * 64;
  float* data = static_cast<float*>(std::aligned_alloc(64, bytes));
  if (data == nullptr) throw std::bad_alloc();
  std::memset(data, 0, bytes);
  return Buffer(data);
}

float* ImagePyramid::GrayRow(int level, int y) {
  return gray_[level].get() + static_cast<std::size_t>(y % kGrayRows) * stride_[level] + kPyramidPadding;
}

void ImagePyramid::Build(const Frame& frame, const PyramidGeometry& geometry) {
  levels_ = geometry.levels;
  for (int level = 0; level < levels_; ++level) {
    const int width = geometry.camera[level].width_px, height = geometry.camera[level].height_px;
    if (width == width_[level] && height == height_[level]) continue;
    width_[level] = width, height_[level] = height;
    stride_[level] = (width + kLineFloats - 1) / kLineFloats * kLineFloats + 2 * kPyramidPadding;
    data_[level] = Allocate(static_cast<std::size_t>(width) * height * kChannels);
    gray_[level] = Allocate(static_cast<std::size_t>(stride_[level]) * kGrayRows);
  }
  const bool corrected = !frame.corrected.empty();
  const cv::Mat& input = corrected ? frame.corrected : frame.image;
  for (int y = 0; y < height_[0]; ++y) {
    float* row = GrayRow(0, y);
    if (geometry.half && corrected) {
      kernels_->halve_floats(input.ptr<float>(2 * y), input.ptr<float>(2 * y + 1), width_[0], row);
    } else if (geometry.half) {
      kernels_->halve_bytes(input.ptr<unsigned char>(2 * y), input.ptr<unsigned char>(2 * y + 1), width_[0], row);
    } else if (corrected) {
      std::copy_n(input.ptr<float>(y), width_[0], row);
    } else {
      kernels_->convert_bytes(input.ptr<unsigned char>(y), width_[0], row);
    }
    AddRow(0, y);
  }
}

// A gray row is read twice more, by the row before for its gradients and by the next level, and is then overwritten:
// all levels grow together and what they read stays in the first cache.
void ImagePyramid::AddRow(int level, int y) {
  const int width = width_[level];
  if (y >= 2) {
    kernels_->add_gradients(GrayRow(level, y - 2), GrayRow(level, y - 1), GrayRow(level, y), width,
                            data_[level].get() + static_cast<std::size_t>(y - 1) * width * kChannels);
  }
  if (y == 0 || y + 1 == height_[level]) {
    const float* gray = GrayRow(level, y);
    float* out = data_[level].get() + static_cast<std::size_t>(y) * width * kChannels;
    for (int x = 0; x < width; ++x, out += kChannels) out[0] = gray[x], out[1] = out[2] = out[3] = 0.0f;
  }
  if (y % 2 == 1 && level + 1 < levels_ && y / 2 < height_[level + 1]) {
    kernels_->halve_floats(GrayRow(level, y - 1), GrayRow(level, y), width_[level + 1], GrayRow(level + 1, y / 2));
    AddRow(level + 1, y / 2);
  }
}

}  // namespace cairn::direct

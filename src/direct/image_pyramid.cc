#include "direct/image_pyramid.h"

#include <algorithm>

namespace cairn::direct {
namespace {

template <class T>
void CopyIntensity(const cv::Mat& image, float* out) {
  for (int y = 0; y < image.rows; ++y) {
    const T* row = image.ptr<T>(y);
    for (int x = 0; x < image.cols; ++x, out += ImagePyramid::kChannels) *out = static_cast<float>(row[x]);
  }
}

template <class T>
void HalveInput(const cv::Mat& image, int width, int height, float* out) {
  for (int y = 0; y < height; ++y) {
    const T* a = image.ptr<T>(2 * y);
    const T* b = image.ptr<T>(2 * y + 1);
    for (int x = 0; x < width; ++x, out += ImagePyramid::kChannels) {
      *out = 0.25f * static_cast<float>(a[2 * x] + a[2 * x + 1] + b[2 * x] + b[2 * x + 1]);
    }
  }
}

void HalveLevel(const float* in, int in_width, int width, int height, float* out) {
  constexpr int c = ImagePyramid::kChannels;
  for (int y = 0; y < height; ++y) {
    const float* a = in + static_cast<std::size_t>(2 * y) * in_width * c;
    const float* b = a + static_cast<std::size_t>(in_width) * c;
    for (int x = 0; x < width; ++x, out += c) {
      *out = 0.25f * (a[2 * c * x] + a[2 * c * x + c] + b[2 * c * x] + b[2 * c * x + c]);
    }
  }
}

void FillGradients(float* data, int width, int height) {
  constexpr int c = ImagePyramid::kChannels;
  const std::ptrdiff_t stride = static_cast<std::ptrdiff_t>(width) * c;
  for (int y = 0; y < height; ++y) {
    float* row = data + y * stride;
    const bool inside = y > 0 && y + 1 < height;
    for (int x = 0; x < width; ++x) {
      float* pixel = row + x * c;
      if (!inside || x == 0 || x + 1 == width) {
        pixel[1] = pixel[2] = pixel[3] = 0.0f;
        continue;
      }
      const float dx = 0.5f * (pixel[c] - pixel[-c]);
      const float dy = 0.5f * (pixel[stride] - pixel[-stride]);
      pixel[1] = dx;
      pixel[2] = dy;
      pixel[3] = dx * dx + dy * dy;
    }
  }
}

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

void ImagePyramid::Build(const Frame& frame, const PyramidGeometry& geometry) {
  for (int level = 0; level < geometry.levels; ++level) {
    width_[level] = geometry.camera[level].width_px;
    height_[level] = geometry.camera[level].height_px;
    data_[level].resize(static_cast<std::size_t>(width_[level]) * height_[level] * kChannels);
  }
  const bool corrected = !frame.irradiance.empty();
  const cv::Mat& input = corrected ? frame.irradiance : frame.image;
  float* base = data_[0].data();
  if (geometry.half) {
    if (corrected) {
      HalveInput<float>(input, width_[0], height_[0], base);
    } else {
      HalveInput<unsigned char>(input, width_[0], height_[0], base);
    }
  } else if (corrected) {
    CopyIntensity<float>(input, base);
  } else {
    CopyIntensity<unsigned char>(input, base);
  }
  FillGradients(base, width_[0], height_[0]);
  for (int level = 1; level < geometry.levels; ++level) {
    HalveLevel(data_[level - 1].data(), width_[level - 1], width_[level], height_[level], data_[level].data());
    FillGradients(data_[level].data(), width_[level], height_[level]);
  }
}

}  // namespace cairn::direct

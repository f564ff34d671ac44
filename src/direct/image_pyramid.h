// Image pyramid with gradients, as the photometric odometry reads it: per pixel four floats
// {intensity, d/dx, d/dy, squared gradient}, so that one bilinear sample is four 16-byte loads.
// Gray levels in [0, 255]; gradients are central differences per pixel of the level, 0 at the border.
#pragma once

#include <cstdlib>
#include <memory>
#include <opencv2/core.hpp>

#include "base/cpu_features.h"
#include "direct/packet.h"
#include "geometry/pinhole.h"

namespace cairn::direct {

struct PyramidKernels;  // direct/pyramid_kernel.h

inline constexpr int kMaxLevels = 8;

// The cameras of all levels; level 0 is the working resolution (2x2 means of the input, or the input itself).
struct PyramidGeometry {
  int levels = 0;
  bool half = true;
  Pinhole camera[kMaxLevels];

  // Halves while the result keeps `min_level_pixels`.
  static PyramidGeometry Make(const Pinhole& full_camera, bool full_resolution, int max_levels, int min_level_pixels);
};

class ImagePyramid {
 public:
  static constexpr int kChannels = 4;

  explicit ImagePyramid(SimdLevel level = ActiveSimdLevel());

  // Frame::corrected if it is there, else Frame::image; the size must fit `geometry`. Reuses its memory.
  void Build(const Frame& frame, const PyramidGeometry& geometry);

  const float* Level(int level) const { return data_[level].get(); }
  int Width(int level) const { return width_[level]; }
  int Height(int level) const { return height_[level]; }
  // Channels of one pixel.
  const float* At(int level, int x, int y) const {
    return data_[level].get() + kChannels * (static_cast<std::size_t>(y) * width_[level] + x);
  }

 private:
  static constexpr int kGrayRows = 3;  // kept per level while building
  struct Free {
    void operator()(float* data) const { std::free(data); }
  };
  using Buffer = std::unique_ptr<float[], Free>;  // on a cache line

  static Buffer Allocate(std::size_t floats);
  float* GrayRow(int level, int y);
  void AddRow(int level, int y);

  const PyramidKernels* kernels_;
  int levels_ = 0;
  Buffer data_[kMaxLevels];
  Buffer gray_[kMaxLevels];  // rows of stride_ floats
  int stride_[kMaxLevels] = {};
  int width_[kMaxLevels] = {};
  int height_[kMaxLevels] = {};
};

// An accepted image with its pyramid. Immutable once handed over.
struct FrameData {
  Frame frame;
  ImagePyramid pyramid;
};

}  // namespace cairn::direct

// A gray texture with its reduced copies, sampled without aliasing: trilinear between levels, several probes along the
// longer axis of the pixel's footprint (after Williams, "Pyramidal parametrics", SIGGRAPH 1983; anisotropic probing as
// in McCormack et al., "Feline", SIGGRAPH 1999).
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace cairn::synth {

class Texture {
 public:
  Texture() = default;
  // CV_8UC1, not empty.
  explicit Texture(const cv::Mat& image);

  int width() const { return levels_.empty() ? 0 : levels_[0].width; }
  int height() const { return levels_.empty() ? 0 : levels_[0].height; }

  // The filtered value in [0, 255] at (u, v) in texels, where (0, 0) is the corner of the first texel, for a pixel
  // whose steps to the right and down move by (du_dx, dv_dx) and (du_dy, dv_dy) texels.
  float Sample(float u, float v, float du_dx, float dv_dx, float du_dy, float dv_dy) const;

 private:
  struct Level {
    int width = 0;
    int height = 0;
    float scale_u = 1.0f;  // texels of this level per texel of level 0
    float scale_v = 1.0f;
    std::size_t offset = 0;
  };
  float Bilinear(const Level& level, float u, float v) const;
  float Trilinear(float u, float v, float lod) const;

  std::vector<Level> levels_;
  std::vector<std::uint8_t> texels_;
};

}  // namespace cairn::synth

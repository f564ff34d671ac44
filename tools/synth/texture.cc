#include "synth/texture.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace cairn::synth {
namespace {

constexpr int kMaxProbes = 8;

// Base-2 logarithm to 0.01, enough to choose a level: exponent plus a parabola for the mantissa.
float FastLog2(float x) {
  const std::uint32_t bits = std::bit_cast<std::uint32_t>(x);
  const float exponent = static_cast<float>(static_cast<int>(bits >> 23) - 127);
  const float m = std::bit_cast<float>((bits & 0x7FFFFFu) | 0x3F800000u) - 1.0f;
  return exponent + m * (1.3465f - 0.3465f * m);
}

}  // namespace

Texture::Texture(const cv::Mat& image) {
  CV_Assert(image.type() == CV_8UC1 && !image.empty());
  cv::Mat level = image;
  while (true) {
    const Level entry{level.cols, level.rows, static_cast<float>(level.cols) / static_cast<float>(image.cols),
                      static_cast<float>(level.rows) / static_cast<float>(image.rows), texels_.size()};
    levels_.push_back(entry);
    for (int y = 0; y < level.rows; ++y) texels_.insert(texels_.end(), level.ptr(y), level.ptr(y) + level.cols);
    if (level.cols == 1 && level.rows == 1) break;
    cv::Mat smaller;
    cv::resize(level, smaller, cv::Size(std::max(1, level.cols / 2), std::max(1, level.rows / 2)), 0, 0,
               cv::INTER_AREA);
    level = smaller;
  }
}

float Texture::Bilinear(const Level& level, float u, float v) const {
  const float x = std::clamp(u * level.scale_u - 0.5f, 0.0f, static_cast<float>(level.width - 1));
  const float y = std::clamp(v * level.scale_v - 0.5f, 0.0f, static_cast<float>(level.height - 1));
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, level.width - 1), y1 = std::min(y0 + 1, level.height - 1);
  const float fx = x - static_cast<float>(x0), fy = y - static_cast<float>(y0);
  const std::uint8_t* top =
      texels_.data() + level.offset + static_cast<std::size_t>(y0) * static_cast<std::size_t>(level.width);
  const std::uint8_t* bottom =
      texels_.data() + level.offset + static_cast<std::size_t>(y1) * static_cast<std::size_t>(level.width);
  const float a = static_cast<float>(top[x0]), b = static_cast<float>(top[x1]);
  const float c = static_cast<float>(bottom[x0]), d = static_cast<float>(bottom[x1]);
  const float above = a + fx * (b - a), below = c + fx * (d - c);
  return above + fy * (below - above);
}

float Texture::Trilinear(float u, float v, float lod) const {
  if (lod <= 0.0f) return Bilinear(levels_[0], u, v);
  const std::size_t last = levels_.size() - 1;
  const std::size_t i = static_cast<std::size_t>(lod);
  if (i >= last) return Bilinear(levels_[last], u, v);
  const float t = lod - static_cast<float>(i);
  const float fine = Bilinear(levels_[i], u, v);
  return fine + t * (Bilinear(levels_[i + 1], u, v) - fine);
}

float Texture::Sample(float u, float v, float du_dx, float dv_dx, float du_dy, float dv_dy) const {
  const float length_x = du_dx * du_dx + dv_dx * dv_dx, length_y = du_dy * du_dy + dv_dy * dv_dy;
  const bool x_is_major = length_x >= length_y;
  const float major = std::sqrt(std::max(length_x, length_y));
  // The parallelogram's width across its longer side, not the shorter side: the two need not be at a right angle.
  const float minor = std::max(std::abs(du_dx * dv_dy - dv_dx * du_dy) / std::max(major, 1e-9f), 1e-6f);
  const int probes = std::clamp(static_cast<int>(std::ceil(major / minor - 0.25f)), 1, kMaxProbes);
  const float width = std::max(minor, major / static_cast<float>(probes));
  const float lod = FastLog2(std::max(width, 1e-6f));
  if (probes == 1 || major <= 1.0f) return Trilinear(u, v, lod);
  const float step_u = (x_is_major ? du_dx : du_dy) / static_cast<float>(probes);
  const float step_v = (x_is_major ? dv_dx : dv_dy) / static_cast<float>(probes);
  float sum = 0.0f;
  for (int k = 0; k < probes; ++k) {
    const float at = static_cast<float>(k) - 0.5f * static_cast<float>(probes - 1);
    sum += Trilinear(u + at * step_u, v + at * step_v, lod);
  }
  return sum / static_cast<float>(probes);
}

}  // namespace cairn::synth

#include "direct/view_search.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace cairn::direct {
namespace {

constexpr int kWidth = 40;
constexpr float kMinVariance = 4.0f;  // gray levels squared; below it there is nothing to compare

float CorrelationAt(const Thumbnail& reference, const Thumbnail& view, int dx, int dy) {
  const int width = reference.width, height = reference.height;
  const int x0 = std::max(0, -dx), x1 = std::min(width, width - dx);
  const int y0 = std::max(0, -dy), y1 = std::min(height, height - dy);
  float a = 0.0f, b = 0.0f, aa = 0.0f, bb = 0.0f, ab = 0.0f;
  for (int y = y0; y < y1; ++y) {
    const float* p = reference.gray.data() + static_cast<std::ptrdiff_t>(y) * width;
    const float* q = view.gray.data() + static_cast<std::ptrdiff_t>(y + dy) * width + dx;
    for (int x = x0; x < x1; ++x) {
      a += p[x], b += q[x];
      aa += p[x] * p[x], bb += q[x] * q[x], ab += p[x] * q[x];
    }
  }
  const float n = static_cast<float>((x1 - x0) * (y1 - y0));
  const float var_a = aa / n - (a / n) * (a / n), var_b = bb / n - (b / n) * (b / n);
  if (var_a < kMinVariance || var_b < kMinVariance) return -1.0f;
  return (ab / n - (a / n) * (b / n)) / std::sqrt(var_a * var_b);
}

}  // namespace

Thumbnail MakeThumbnail(const ImagePyramid& image, const PyramidGeometry& geometry) {
  Thumbnail thumbnail;
  while (thumbnail.level + 1 < geometry.levels && geometry.camera[thumbnail.level].width_px > kWidth) {
    ++thumbnail.level;
  }
  thumbnail.width = image.Width(thumbnail.level);
  thumbnail.height = image.Height(thumbnail.level);
  const std::size_t pixels = static_cast<std::size_t>(thumbnail.width) * static_cast<std::size_t>(thumbnail.height);
  thumbnail.gray.resize(pixels);
  const float* from = image.Level(thumbnail.level);
  for (std::size_t i = 0; i < pixels; ++i) thumbnail.gray[i] = from[ImagePyramid::kChannels * i];
  return thumbnail;
}

ViewShift FindShift(const Thumbnail& reference, const Thumbnail& view, const PyramidGeometry& geometry) {
  ViewShift best;
  if (reference.gray.empty() || reference.gray.size() != view.gray.size() || reference.width != view.width) return best;
  int best_dx = 0, best_dy = 0;
  for (int dy = -reference.height / 2; dy <= reference.height / 2; ++dy) {
    for (int dx = -reference.width / 2; dx <= reference.width / 2; ++dx) {
      const double correlation = CorrelationAt(reference, view, dx, dy);
      if (correlation > best.correlation) best.correlation = correlation, best_dx = dx, best_dy = dy;
    }
  }
  // The middle of the overlap: its ray in the reference must turn into that in the view.
  const Pinhole& camera = geometry.camera[reference.level];
  const Vector2d middle(0.5 * (reference.width - 1 - best_dx), 0.5 * (reference.height - 1 - best_dy));
  const Vector2d shifted = middle + Vector2d(best_dx, best_dy);
  best.new_from_reference = Quaterniond::FromTwoVectors(camera.Unproject(middle), camera.Unproject(shifted));
  return best;
}

}  // namespace cairn::direct

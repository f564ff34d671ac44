#include "geometry/pinhole_fit.h"

#include <algorithm>
#include <cmath>

#include "base/median.h"

namespace cairn {
namespace {

constexpr std::size_t kMinPoints = 20;
constexpr int kRepeats = 3;
constexpr double kMaxErrors = 3.0;
// A camera that sees less than this, as the tangent of half the angle, has its focal length from noise.
constexpr double kMinSpread = 0.01;

struct Line {
  double slope = 0.0;
  double offset = 0.0;
};

// pixel = slope * tangent + offset over the points that count.
std::optional<Line> FitLine(const std::vector<double>& tangents, const std::vector<double>& pixels,
                            const std::vector<bool>& counts) {
  double n = 0, sum_t = 0, sum_p = 0;
  for (std::size_t i = 0; i < tangents.size(); ++i) {
    if (!counts[i]) continue;
    n += 1, sum_t += tangents[i], sum_p += pixels[i];
  }
  if (n < static_cast<double>(kMinPoints)) return std::nullopt;
  double tt = 0, tp = 0;
  for (std::size_t i = 0; i < tangents.size(); ++i) {
    if (!counts[i]) continue;
    const double t = tangents[i] - sum_t / n;
    tt += t * t, tp += t * (pixels[i] - sum_p / n);
  }
  if (std::sqrt(tt / n) < kMinSpread) return std::nullopt;
  return Line{tp / tt, (sum_p - tp / tt * sum_t) / n};
}

}  // namespace

std::optional<PinholeFit> FitPinhole(const std::vector<SeenPoint>& seen) {
  std::vector<double> x, y, u, v;
  for (const SeenPoint& point : seen) {
    if (!(point.point_c.z() > 0.0)) continue;
    x.push_back(point.point_c.x() / point.point_c.z());
    y.push_back(point.point_c.y() / point.point_c.z());
    u.push_back(point.pixel.x());
    v.push_back(point.pixel.y());
  }
  if (x.size() < kMinPoints) return std::nullopt;
  std::vector<bool> counts(x.size(), true);
  std::vector<double> errors(x.size());
  PinholeFit fit;
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    const std::optional<Line> across = FitLine(x, u, counts), down = FitLine(y, v, counts);
    if (!across || !down || !(across->slope > 0.0) || !(down->slope > 0.0)) return std::nullopt;
    fit.camera = {0, 0, across->slope, down->slope, across->offset, down->offset};
    for (std::size_t i = 0; i < x.size(); ++i) {
      errors[i] = std::hypot(across->slope * x[i] + across->offset - u[i], down->slope * y[i] + down->offset - v[i]);
    }
    fit.median_error_px = Median(errors);
    for (std::size_t i = 0; i < x.size(); ++i) counts[i] = errors[i] <= kMaxErrors * fit.median_error_px + 1e-9;
  }
  const auto size = [](double center, const std::vector<double>& pixels) {
    return static_cast<int>(
        std::max(std::round(2.0 * center) + 1.0, std::ceil(*std::max_element(pixels.begin(), pixels.end())) + 1.0));
  };
  fit.camera.width_px = size(fit.camera.cx_px, u);
  fit.camera.height_px = size(fit.camera.cy_px, v);
  return fit;
}

}  // namespace cairn

#include "direct/point_tracer.h"

#include <algorithm>
#include <cmath>

namespace cairn::direct {
namespace {

constexpr int kMaxSteps = 100;
constexpr float kSecondBestRadiusPx = 2.0f;
constexpr float kMaxErrorPx = 10.0f;
constexpr float kTraceBorderPx = 4.0f;
constexpr float kReachPx = kTraceBorderPx - 0.5f;  // of the turned and scaled pattern

struct Segment {
  float x, y;    // of the smallest inverse depth
  float dx, dy;  // unit direction towards larger inverse depth
  float length;
  bool bounded;
};

bool Inside(const ImagePyramid& image, float x, float y) {
  return x > kTraceBorderPx && y > kTraceBorderPx && x < static_cast<float>(image.Width(0)) - kTraceBorderPx - 1.0f &&
         y < static_cast<float>(image.Height(0)) - kTraceBorderPx - 1.0f;
}

// The part of the epipolar line to search; a status other than kGood ends the trace.
TraceStatus FindSegment(const ImagePyramid& image, const PairProjection& pair, const float* ray, float max_search,
                        const ImmaturePoint& point, Segment* segment) {
  const auto project = [&](float inverse_depth, float* u, float* v) {
    const float z = ray[2] + pair.shift[2] * inverse_depth;
    *u = (ray[0] + pair.shift[0] * inverse_depth) / z;
    *v = (ray[1] + pair.shift[1] * inverse_depth) / z;
    return z;
  };
  if (project(point.min_inverse_depth, &segment->x, &segment->y) < 1e-3f) return TraceStatus::kOutOfImage;
  if (!Inside(image, segment->x, segment->y)) return TraceStatus::kOutOfImage;
  segment->bounded = point.max_inverse_depth >= 0.0f;
  float end_x, end_y;
  if (segment->bounded) {
    if (project(point.max_inverse_depth, &end_x, &end_y) < 1e-3f) return TraceStatus::kOutOfImage;
    if (!Inside(image, end_x, end_y)) return TraceStatus::kOutOfImage;
    segment->dx = end_x - segment->x, segment->dy = end_y - segment->y;
    segment->length = std::hypot(segment->dx, segment->dy);
    if (segment->length < 1e-4f) {
      segment->length = 0.0f;
      return TraceStatus::kSkipped;
    }
  } else {
    segment->length = max_search;
    // The direction of the line at the far point: derivative of the projection by the inverse depth.
    const float z = ray[2] + pair.shift[2] * point.min_inverse_depth;
    segment->dx = (pair.shift[0] - pair.shift[2] * segment->x) / z;
    segment->dy = (pair.shift[1] - pair.shift[2] * segment->y) / z;
  }
  const float norm = std::hypot(segment->dx, segment->dy);
  if (!(norm > 1e-6f)) return TraceStatus::kOutOfImage;
  segment->dx /= norm, segment->dy /= norm;
  if (!segment->bounded) {
    // Shorten to stay inside.
    while (segment->length > 1.0f &&
           !Inside(image, segment->x + segment->length * segment->dx, segment->y + segment->length * segment->dy)) {
      segment->length -= 1.0f;
    }
  }
  return TraceStatus::kGood;
}

}  // namespace

bool MakeImmaturePoint(const ImagePyramid& image, int x, int y, double gradient_constant_gray, double outlier_gray,
                       ImmaturePoint* point) {
  *point = ImmaturePoint();
  point->x = static_cast<float>(x);
  point->y = static_cast<float>(y);
  const float c2 = static_cast<float>(gradient_constant_gray * gradient_constant_gray);
  for (int k = 0; k < kPatternSize; ++k) {
    const float* pixel = image.At(0, x + static_cast<int>(kPatternX[k]), y + static_cast<int>(kPatternY[k]));
    point->color[k] = pixel[0];
    point->weight[k] = c2 / (c2 + pixel[3]);
    point->gradient_xx += pixel[1] * pixel[1];
    point->gradient_xy += pixel[1] * pixel[2];
    point->gradient_yy += pixel[2] * pixel[2];
  }
  point->energy_limit = static_cast<float>(kPatternSize * outlier_gray * outlier_gray);
  return point->gradient_xx + point->gradient_yy > 1.0f;
}

float ProjectInto(const PairProjection& pair, float x, float y, float inverse_depth, float* u, float* v) {
  const float z = pair.warp[6] * x + pair.warp[7] * y + pair.warp[8] + pair.shift[2] * inverse_depth;
  if (z < kMinDepthRatio) return z;
  *u = (pair.warp[0] * x + pair.warp[1] * y + pair.warp[2] + pair.shift[0] * inverse_depth) / z;
  *v = (pair.warp[3] * x + pair.warp[4] * y + pair.warp[5] + pair.shift[1] * inverse_depth) / z;
  return z;
}

PairProjection MakePairProjection(const Pinhole& camera, const SE3& target_from_host, double gain, double target_offset,
                                  double host_offset) {
  Matrix3d k, inverse_k;
  k << camera.fx_px, 0.0, camera.cx_px, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 1.0;
  inverse_k << 1.0 / camera.fx_px, 0.0, -camera.cx_px / camera.fx_px, 0.0, 1.0 / camera.fy_px,
      -camera.cy_px / camera.fy_px, 0.0, 0.0, 1.0;
  PairProjection pair;
  const Eigen::Matrix<float, 3, 3, Eigen::RowMajor> warp =
      (k * target_from_host.RotationMatrix() * inverse_k).cast<float>();
  std::copy(warp.data(), warp.data() + 9, pair.warp);
  const Eigen::Vector3f shift = (k * target_from_host.translation()).cast<float>();
  std::copy(shift.data(), shift.data() + 3, pair.shift);
  pair.gain = pair.linear_gain = static_cast<float>(gain);
  pair.offset = static_cast<float>(target_offset);
  pair.host_offset = pair.linear_host_offset = static_cast<float>(host_offset);
  return pair;
}

TraceStatus TracePoint(const ImagePyramid& image, const PairProjection& pair, const TraceOptions& options,
                       ImmaturePoint* point) {
  if (point->status == TraceStatus::kOutOfImage) return point->status;
  const float* m = pair.warp;
  const float ray[3] = {m[0] * point->x + m[1] * point->y + m[2], m[3] * point->x + m[4] * point->y + m[5],
                        m[6] * point->x + m[7] * point->y + m[8]};
  Segment segment;
  const TraceStatus found = FindSegment(image, pair, ray, static_cast<float>(options.max_search_px), *point, &segment);
  if (found == TraceStatus::kOutOfImage) return found;  // it may come back
  const float slack = static_cast<float>(options.slack_px);
  if (found == TraceStatus::kSkipped || (segment.bounded && segment.length < slack)) {
    point->interval_px = segment.length;
    return point->status = TraceStatus::kSkipped;
  }
  // How far the match may be off along the line: little where the gradient is along it, much where it is across.
  const float along = segment.dx * segment.dx * point->gradient_xx +
                      2.0f * segment.dx * segment.dy * point->gradient_xy +
                      segment.dy * segment.dy * point->gradient_yy;
  const float across = segment.dy * segment.dy * point->gradient_xx -
                       2.0f * segment.dx * segment.dy * point->gradient_xy +
                       segment.dx * segment.dx * point->gradient_yy;
  float error_px = along > 0.0f ? 0.2f + 0.2f * (along + across) / along : kMaxErrorPx;
  if (segment.bounded && error_px * 2.0f > segment.length) {
    point->interval_px = segment.length;
    return point->status = TraceStatus::kBadCondition;
  }
  error_px = std::min(error_px, kMaxErrorPx);

  TracePattern pattern;
  // The warp's 2x2 part, scaled by its own depth term, turns the pattern.
  const float inverse_z = 1.0f / ray[2];
  for (int k = 0; k < kPatternSize; ++k) {
    const float px = (ray[0] + m[0] * kPatternX[k] + m[1] * kPatternY[k]);
    const float py = (ray[1] + m[3] * kPatternX[k] + m[4] * kPatternY[k]);
    const float pz = (ray[2] + m[6] * kPatternX[k] + m[7] * kPatternY[k]);
    // In this order a number that is none becomes a bound.
    pattern.dx[k] = std::min(kReachPx, std::max(-kReachPx, px / pz - ray[0] * inverse_z));
    pattern.dy[k] = std::min(kReachPx, std::max(-kReachPx, py / pz - ray[1] * inverse_z));
    pattern.expected[k] = pair.offset + pair.gain * (point->color[k] - pair.host_offset);
  }
  TraceLine line;
  line.image = image.Level(0);
  line.width = image.Width(0), line.height = image.Height(0);
  line.pattern = &pattern;
  line.border = kTraceBorderPx;
  line.huber = static_cast<float>(options.huber_gray);
  line.x = segment.x, line.y = segment.y, line.dx = segment.dx, line.dy = segment.dy;

  // Discrete search, one pixel per step, from a little before the interval to a little behind it.
  const float margin = segment.bounded ? std::min(error_px, 2.0f) : 0.0f;
  const float length =
      std::min(segment.length + 2.0f * margin, static_cast<float>(options.max_search_px) + 2.0f * margin);
  const int steps = std::min(static_cast<int>(length) + 2, kMaxSteps);
  const float step = length / static_cast<float>(steps - 1);
  float energies[kMaxSteps];
  float best_energy = kOutsideEnergy;
  int best = -1;
  options.kernels->energies(line, -margin, step, steps, energies);
  for (int i = 0; i < steps; ++i) {
    if (energies[i] < best_energy) best_energy = energies[i], best = i;
  }
  if (best < 0) return TraceStatus::kOutOfImage;
  float second = kOutsideEnergy;
  for (int i = 0; i < steps; ++i) {
    if (std::abs(static_cast<float>(i - best)) * step > kSecondBestRadiusPx) second = std::min(second, energies[i]);
  }
  const float quality = second / std::max(best_energy, 1e-3f);
  if (quality < point->quality || steps > 10) point->quality = quality;

  // Gauss-Newton along the line.
  float t = -margin + static_cast<float>(best) * step;
  const float t_start = t;
  float step_back = 0.0f, energy_now = 1e30f, limit = 1.0f;
  for (int iteration = 0; iteration < options.refinement_steps; ++iteration) {
    const float x = segment.x + t * segment.dx, y = segment.y + t * segment.dy;
    if (!Inside(image, x, y)) break;
    TraceSums sums;
    options.kernels->derivative(line, x, y, &sums);
    if (sums.energy > energy_now) {  // went too far: half of the last step
      step_back *= 0.5f;
      t -= step_back;
      continue;
    }
    energy_now = sums.energy;
    step_back = std::clamp(-sums.b / (1.0f + sums.h), -limit, limit);
    limit *= 0.75f;
    t += step_back;
    if (std::abs(step_back) < 0.02f) break;
  }
  if (std::abs(t - t_start) > 1.5f || !Inside(image, segment.x + t * segment.dx, segment.y + t * segment.dy))
    t = t_start;

  if (!(best_energy < point->energy_limit)) {
    point->interval_px = segment.length;
    return point->status = point->status == TraceStatus::kOutlier ? TraceStatus::kOutOfImage : TraceStatus::kOutlier;
  }

  // Interval of the inverse depth from the pixel interval, along the image axis that moves more.
  const float near_x = segment.x + (t + error_px) * segment.dx, near_y = segment.y + (t + error_px) * segment.dy;
  const float far_x = segment.x + (t - error_px) * segment.dx, far_y = segment.y + (t - error_px) * segment.dy;
  float low, high;
  if (std::abs(segment.dx) > std::abs(segment.dy)) {
    low = (ray[2] * far_x - ray[0]) / (pair.shift[0] - pair.shift[2] * far_x);
    high = (ray[2] * near_x - ray[0]) / (pair.shift[0] - pair.shift[2] * near_x);
  } else {
    low = (ray[2] * far_y - ray[1]) / (pair.shift[1] - pair.shift[2] * far_y);
    high = (ray[2] * near_y - ray[1]) / (pair.shift[1] - pair.shift[2] * near_y);
  }
  if (low > high) std::swap(low, high);
  if (!std::isfinite(low) || !std::isfinite(high) || high < 0.0f) {
    return point->status = point->status == TraceStatus::kOutlier ? TraceStatus::kOutOfImage : TraceStatus::kOutlier;
  }
  point->min_inverse_depth = std::max(low, 0.0f);
  point->max_inverse_depth = high;
  point->interval_px = 2.0f * error_px;
  if (point->good_traces < 255) ++point->good_traces;
  return point->status = TraceStatus::kGood;
}

}  // namespace cairn::direct

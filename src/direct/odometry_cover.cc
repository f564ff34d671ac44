// What stands before the view while a keyframe is made (direct/cover_mask.h).
#include <cmath>

#include "direct/odometry_impl.h"
#include "direct/point_tracer.h"

namespace cairn::direct {
namespace {

constexpr int kNearPx = 3;
constexpr int kCoverMatchReachPx = 3;

// Whether a point is found near to where it is expected: where the pose is a little off, most points do not fit, but
// all are near; behind an obstacle none is.
bool FoundNear(const ActivePoint& point, const PairProjection& pair, const ImagePyramid& image, float x, float y,
               float huber, float limit) {
  const int u = static_cast<int>(x), v = static_cast<int>(y), reach = kNearPx + kPatternRadiusPx;
  if (u < reach || v < reach || u + reach + 1 >= image.Width(0) || v + reach + 1 >= image.Height(0)) return true;
  const float a = x - static_cast<float>(u), b = y - static_cast<float>(v);
  for (int dy = -kNearPx; dy <= kNearPx; ++dy) {
    for (int dx = -kNearPx; dx <= kNearPx; ++dx) {
      float energy = 0.0f;
      for (int k = 0; k < kPatternSize && energy <= limit; ++k) {
        const int px = u + dx + static_cast<int>(kPatternX[k]), py = v + dy + static_cast<int>(kPatternY[k]);
        const float *above = image.At(0, px, py), *below = image.At(0, px, py + 1);
        const float value = (1.0f - b) * ((1.0f - a) * above[0] + a * above[ImagePyramid::kChannels]) +
                            b * ((1.0f - a) * below[0] + a * below[ImagePyramid::kChannels]);
        const float residual = std::abs(value - pair.offset - pair.gain * (point.color[k] - pair.host_offset));
        const float weight = residual < huber ? 1.0f : huber / residual;
        energy += point.weight[k] * weight * residual * residual * (2.0f - weight);
      }
      if (energy <= limit) return true;
    }
  }
  return false;
}

}  // namespace

// Decides from the newest keyframe, before its window is optimized, and takes the points behind an obstacle out of it.
void Odometry::Impl::FindCover() {
  const int newest = window_.size() - 1;
  if (newest < 1) return;
  if (!cover_.mask.any()) {
    std::lock_guard lock(mutex_);
    cover_.clear_reference = references_.empty() ? nullptr : references_.back();
  }
  const Keyframe &keyframe = window_.newest(), &before = window_.keyframe(newest - 1);
  cover_.mask.Begin();
  cover_.positions.assign(window_.points().size(), {-1.0f, -1.0f});
  std::vector<PairProjection>& to_newest = cover_.to_newest;
  to_newest.resize(static_cast<std::size_t>(newest));
  for (int h = 0; h < newest; ++h) to_newest[h] = window_.Projection(h, newest);
  const float limit = static_cast<float>(kPatternSize * options_.outlier_gray * options_.outlier_gray);
  for (std::size_t i = 0; i < window_.points().size(); ++i) {
    const ActivePoint& point = window_.points()[i];
    if (point.host >= newest) continue;
    const ResidualState last = point.residuals[newest - 1].state;
    float energy;
    if (!window_.EnergyAgainst(point, newest, &energy)) continue;
    const PairProjection& p = to_newest[point.host];
    Cover::Position& at = cover_.positions[i];
    if (ProjectInto(p, point.x, point.y, point.inverse_depth, &at.x, &at.y) < kMinDepthRatio) continue;
    const bool tracked = last == ResidualState::kGood || last == ResidualState::kCovered || point.host == newest - 1;
    if (!tracked) continue;
    const bool fits =
        energy <= limit || FoundNear(point, p, keyframe.data->pyramid, cover_.positions[i].x, cover_.positions[i].y,
                                     static_cast<float>(options_.huber_gray), limit);
    cover_.mask.AddTracked(cover_.positions[i].x, cover_.positions[i].y, fits);
  }
  std::shared_ptr<const TrackingReference> last;
  {
    std::lock_guard lock(mutex_);
    if (!references_.empty()) last = references_.back();
  }
  for (const auto& reference : {last, cover_.clear_reference}) {
    if (reference == nullptr) continue;
    const SE3 newest_from_reference = keyframe.camera_from_direct * KeyframePoseOf(reference->keyframe);
    cover_.mask.AddMatches(cover_.matcher.Match(geometry_, *reference, keyframe.data->pyramid, newest_from_reference,
                                                CellGrid::kImage, kCoverMatchReachPx));
  }
  const double gain = ExposureRatio(keyframe.data->frame.exposure_gain, before.data->frame.exposure_gain) *
                      std::exp(keyframe.light.a - before.light.a);
  cover_.mask.AddStill(keyframe.data->pyramid, before.data->pyramid,
                       (keyframe.camera_from_direct * before.camera_from_direct.Inverse()).RotationMatrix(), gain,
                       keyframe.light.b - gain * before.light.b);
  cover_.mask.Decide(keyframe.data->frame.time_ns);
  if (!cover_.mask.any()) return;
  for (std::size_t i = 0; i < window_.points().size(); ++i) {
    if (cover_.positions[i].x < 0.0f || !cover_.mask.Covered(cover_.positions[i].x, cover_.positions[i].y)) continue;
    window_.points()[i].residuals[newest].state = ResidualState::kCovered;
  }
  // Candidates chosen before it was known.
  for (ImmaturePoint& point : window_.keyframe(newest - 1).immature) {
    if (cover_.mask.Still(point.x, point.y)) point.status = TraceStatus::kOutOfImage;
  }
}

}  // namespace cairn::direct

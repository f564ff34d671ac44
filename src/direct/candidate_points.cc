#include "direct/candidate_points.h"

#include <algorithm>
#include <cmath>

#include "direct/light.h"

namespace cairn::direct {
namespace {

constexpr int kCandidateBorderPx = 4;
constexpr float kMaxActivationIntervalPx = 8.0f;
constexpr double kMaxSpacingPx = 12.0;
constexpr double kPassSpacing[3] = {1.0, 1.5, 2.0};

}  // namespace

CandidatePoints::CandidatePoints(const OdometryOptions& options, const PyramidGeometry& geometry, Window* window,
                                 const CoverMask* cover)
    : options_(options), geometry_(geometry), window_(window), cover_(cover) {
  trace_options_.max_search_px =
      options.max_search_share * (geometry_.camera[0].width_px + geometry_.camera[0].height_px);
  trace_options_.slack_px = options.trace_slack_px;
  trace_options_.huber_gray = options.huber_gray;
}

void CandidatePoints::Select(Keyframe* keyframe) {
  const ImagePyramid& pyramid = keyframe->data->pyramid;
  selector_.Select(pyramid, options_.candidates_per_keyframe, options_.gradient_offset_gray, kCandidateBorderPx,
                   &selected_);
  keyframe->immature.clear();
  keyframe->immature.reserve(selected_.size());
  ImmaturePoint point;
  for (const SelectedPixel& pixel : selected_) {
    if (cover_->Covered(pixel.x, pixel.y)) continue;
    if (!MakeImmaturePoint(pyramid, pixel.x, pixel.y, options_.gradient_constant_gray, options_.outlier_gray, &point))
      continue;
    point.pass = pixel.pass;
    keyframe->immature.push_back(point);
  }
}

// Whether a candidate is behind an obstacle, where it is expected by what is known of its depth.
bool CandidatePoints::Hidden(const PairProjection& pair, const ImmaturePoint& point, const CellSet& covered) const {
  const float inverse_depth = point.max_inverse_depth > 0.0f
                                  ? 0.5f * (point.min_inverse_depth + point.max_inverse_depth)
                                  : point.min_inverse_depth;
  const Pinhole& camera = geometry_.camera[0];
  float u, v;
  if (ProjectInto(pair, point.x, point.y, inverse_depth, &u, &v) < kMinDepthRatio) return false;
  return camera.Contains(Vector2d(u, v), 0.0) &&
         (cover_->Covered(u, v) || covered[CellOf(camera, static_cast<double>(u), static_cast<double>(v))]);
}

void CandidatePoints::TraceOne(const ImagePyramid& image, const PairProjection& pair, Keyframe* host) const {
  for (ImmaturePoint& point : host->immature) TracePoint(image, pair, trace_options_, &point);
}

void CandidatePoints::Trace(const FrameData& data, const SE3& camera_from_direct, const AffineLight& light,
                            const CellSet& covered) {
  const bool any = cover_->any() || covered != CellSet{};
  for (int k = 0; k < window_->size(); ++k) {
    Keyframe& host = window_->keyframe(k);
    const double gain =
        ExposureRatio(data.frame.exposure_gain, host.data->frame.exposure_gain) * std::exp(light.a - host.light.a);
    const PairProjection pair = MakePairProjection(
        geometry_.camera[0], camera_from_direct * host.camera_from_direct.Inverse(), gain, light.b, host.light.b);
    for (ImmaturePoint& point : host.immature) {
      if (any && Hidden(pair, point, covered)) continue;
      TracePoint(data.pyramid, pair, trace_options_, &point);
    }
  }
}

// Fewer points than wanted: closer to each other, and the other way round.
void CandidatePoints::AdaptSpacing() {
  const auto seen = [n = window_->size() - 1](const ActivePoint& point) {
    return point.residuals[n].state != ResidualState::kCovered;
  };
  const double have = static_cast<double>(std::count_if(window_->points().begin(), window_->points().end(), seen)) /
                      options_.max_active_points;
  const double change = have < 0.66   ? -0.8
                        : have < 0.8  ? -0.5
                        : have < 0.9  ? -0.2
                        : have < 1.0  ? -0.1
                        : have > 1.5  ? 0.8
                        : have > 1.3  ? 0.5
                        : have > 1.15 ? 0.2
                                      : 0.1;
  spacing_px_ = std::clamp(spacing_px_ + 2.0 * change, 0.0, kMaxSpacingPx);
}

void CandidatePoints::Activate(const std::vector<bool>& goes) {
  AdaptSpacing();
  const int newest = window_->size() - 1;
  const Pinhole& camera = geometry_.camera[0];
  spacing_.Reset(camera.width_px, camera.height_px);
  std::vector<PairProjection> to_newest(window_->size());
  for (int h = 0; h < newest; ++h) to_newest[h] = window_->Projection(h, newest);
  const auto project = [&](int host, float x, float y, float inverse_depth, float* u, float* v) {
    if (ProjectInto(to_newest[host], x, y, inverse_depth, u, v) < kMinDepthRatio) return false;
    return *u > 2.0f && *v > 2.0f && *u < static_cast<float>(camera.width_px - 3) &&
           *v < static_cast<float>(camera.height_px - 3);
  };
  float u, v;
  for (const ActivePoint& point : window_->points()) {
    if (point.host < newest && project(point.host, point.x, point.y, point.inverse_depth, &u, &v)) spacing_.Add(u, v);
  }
  // With only a start's few keyframes one agreeing image must do.
  const int min_good = 1;
  ActivePoint active;
  for (int h = 0; h < newest; ++h) {
    std::vector<ImmaturePoint>& immature = window_->keyframe(h).immature;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < immature.size(); ++i) {
      const ImmaturePoint& point = immature[i];
      if (point.status == TraceStatus::kOutOfImage) continue;  // an outlier twice
      const bool known = point.max_inverse_depth > 0.0f && point.interval_px < kMaxActivationIntervalPx &&
                         point.quality > options_.min_trace_quality && point.status != TraceStatus::kOutlier &&
                         point.status != TraceStatus::kNew;
      const float middle = 0.5f * (point.min_inverse_depth + point.max_inverse_depth);
      bool keep = !goes[h];
      if (known && project(h, point.x, point.y, middle, &u, &v) && !cover_->Covered(u, v) &&
          !spacing_.HasNeighbour(u, v, static_cast<float>(spacing_px_ * kPassSpacing[point.pass]))) {
        keep = false;
        if (window_->RefineCandidate(point, h, options_.min_activation_hessian, min_good, &active)) {
          window_->AddPoint(active);
          ++window_->keyframe(h).points_made;
          spacing_.Add(u, v);
        }
      }
      if (keep) {
        if (kept != i) immature[kept] = immature[i];
        ++kept;
      }
    }
    immature.resize(kept);
  }
}

}  // namespace cairn::direct

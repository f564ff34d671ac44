// What the sliding window holds: keyframes, their points and the points that are still candidates.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "direct/coarse_tracker.h"
#include "direct/image_pyramid.h"
#include "direct/packet.h"
#include "direct/residual_kernel.h"
#include "geometry/se3.h"

namespace cairn::direct {

inline constexpr int kMaxWindow = 12;     // keyframes
inline constexpr int kFrameUnknowns = 8;  // left increment of camera_from_direct (translation, rotation), a, b
using Vector8d = Eigen::Matrix<double, 8, 1>;
using Matrix8d = Eigen::Matrix<double, 8, 8>;

// kCovered: something stands before the point (direct/cover_mask.h); nothing is known, and it is no sign against it.
enum class ResidualState : std::uint8_t { kNone, kGood, kOutOfImage, kOutlier, kCovered };

inline bool HasResidual(ResidualState state) {
  return state != ResidualState::kNone && state != ResidualState::kCovered;
}

// Of a point, per keyframe of the window.
struct PointResidual {
  ResidualState state = ResidualState::kNone;
  float energy = 0.0f;
};

struct ActivePoint {
  float x = 0.0f;  // pixels of level 0 in the host
  float y = 0.0f;
  float inverse_depth = 0.0f;
  float hessian = 0.0f;    // information of the inverse depth, for a noise of one gray level
  int host = 0;            // index in the window
  int good_residuals = 0;  // ever, counted once per keyframe
  float color[kPatternSize] = {};
  float weight[kPatternSize] = {};
  std::array<PointResidual, kMaxWindow> residuals = {};
};

enum class TraceStatus : std::uint8_t { kNew, kGood, kOutOfImage, kOutlier, kSkipped, kBadCondition };

// A candidate whose inverse depth is known to an interval only.
struct ImmaturePoint {
  float x = 0.0f;
  float y = 0.0f;
  float min_inverse_depth = 0.0f;
  float max_inverse_depth = -1.0f;  // negative: not bounded yet
  float quality = 10000.0f;         // second-best over best energy of the last searches
  float interval_px = 0.0f;         // uncertainty of the last trace in pixels
  float gradient_xx = 0.0f, gradient_xy = 0.0f, gradient_yy = 0.0f;  // summed over the pattern
  float energy_limit = 0.0f;
  std::uint8_t pass = 0;  // of the pixel selector
  std::uint8_t good_traces = 0;
  TraceStatus status = TraceStatus::kNew;
  float color[kPatternSize] = {};
  float weight[kPatternSize] = {};
};

// A point that left the window with a good depth; it stays known for packets.
struct SettledPoint {
  float x = 0.0f;
  float y = 0.0f;
  float inverse_depth = 0.0f;
  float hessian = 0.0f;
};

struct Keyframe {
  std::int64_t id = 0;
  std::int64_t segment = 0;
  std::shared_ptr<const FrameData> data;

  SE3 camera_from_direct;  // current = Exp(delta) * linear
  AffineLight light;
  // First estimate at which Jacobians are taken once the keyframe is part of the marginalization prior.
  SE3 linear_camera_from_direct;
  AffineLight linear_light;
  Vector8d delta = Vector8d::Zero();
  bool in_prior = false;
  Vector8d own_prior = Vector8d::Zero();  // diagonal information against linear (first keyframe) or zero light

  float energy_limit = 0.0f;  // of one residual pattern
  int points_made = 0;        // candidates ever activated
  int points_gone = 0;
  std::vector<ImmaturePoint> immature;
  std::vector<SettledPoint> settled;
};

}  // namespace cairn::direct

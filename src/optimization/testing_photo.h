// A photo of a scene of points between two depths, some of whose matches are wrong; for tests.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "base/random.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"
#include "optimization/pose_refinement.h"

namespace cairn::optimization {

struct Photo {
  SE3 camera_from_map;
  std::vector<PoseObservation> observations;
};

struct PhotoOptions {
  double wrong_share = 0.1;
  double nearest = 1.0, farthest = 6.0;  // depths
  int num_matches = 200;
  double noise = 0.8;  // share of sigma_px
  double pose_spread = 1.0;
};

inline Photo TakePhoto(const Pinhole& pinhole, std::uint64_t seed, const PhotoOptions& options = {}) {
  Random random(seed);
  Vector6d tangent;
  for (int i = 0; i < 6; ++i) tangent[i] = options.pose_spread * random.Normal();
  Photo photo{SE3::Exp(tangent), {}};
  const auto anywhere = [&] {
    return Vector2d(random.Uniform(0, pinhole.width_px - 1), random.Uniform(0, pinhole.height_px - 1));
  };
  for (int i = 0; i < options.num_matches; ++i) {
    const Vector2d pixel = anywhere();
    PoseObservation o;
    o.sigma_px = std::pow(1.2, static_cast<double>(random.Below(6)));
    o.point = photo.camera_from_map.Inverse() *
              (random.Uniform(options.nearest, options.farthest) * pinhole.Unproject(pixel));
    o.pixel = pixel + options.noise * o.sigma_px * Vector2d(random.Normal(), random.Normal());
    if (random.Uniform() < options.wrong_share) o.pixel = anywhere();
    photo.observations.push_back(o);
  }
  return photo;
}

inline Pinhole WithFocal(Pinhole pinhole, double factor) {
  pinhole.fx_px *= factor;
  pinhole.fy_px *= factor;
  return pinhole;
}

}  // namespace cairn::optimization

// What stands for an image where its pixels are not sent: its features, extracted as the map's own were.
#pragma once

#include <cstddef>

#include "geometry/camera.h"
#include "image/feature.h"

namespace cairn::api {

inline constexpr std::size_t kMaxImageFeatures = 20'000;

struct ImageFeatures {
  // Keypoints in pixels of `pinhole`: those of the image once its distortion is taken away.
  image::Features features;
  Pinhole pinhole;
  image::OrbParameters orb;  // that they were extracted with; how many were asked for is of no account
};

}  // namespace cairn::api

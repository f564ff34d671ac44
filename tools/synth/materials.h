// Procedural surfaces: seeded gray images that look like the materials of a furnished building and, but for the blank
// and the soft-edged ones, have many corners and gradients at every scale and nowhere repeat.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

namespace cairn::synth {

enum class Material {
  kBlank,      // a painted wall: next to nothing to see
  kPlaster,    // stained, speckled wall
  kWallpaper,  // printed pattern with variations
  kBrick,
  kPaneling,  // vertical boards
  kConcrete,
  kWood,
  kTiles,  // floor tiles of varying shade
  kCarpet,
  kCeiling,  // perforated ceiling panels
  kPoster,   // printed shapes and words in a frame
  kPage,     // lines of text
  kBooks,    // a row of spines
  kCardboard,
  kScreen,  // windows and text on a dark ground
  kMetal,   // drawers with labels
  kFabric,
  kDoor,
  kWindow,
  kStripes,  // soft-edged stripes: gradients in plenty, next to no corners at any scale
};

// CV_8UC1 reflectance, 255 = white. The same arguments give the same bytes.
cv::Mat MakeMaterial(Material material, double width_m, double height_m, double texels_per_m, std::uint64_t seed);

}  // namespace cairn::synth

// ORB keypoints and their 256-bit descriptors (Rublee et al., "ORB: an efficient alternative to SIFT or SURF", 2011).
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace cairn::image {

// In pixels of the full-resolution undistorted image, whatever pyramid level it was found at.
struct Keypoint {
  float x_px = 0.0f;
  float y_px = 0.0f;
  float angle_rad = 0.0f;   // of the intensity centroid, in [-pi, pi)
  std::uint8_t octave = 0;  // pyramid level; the scale is scale_factor^octave

  bool operator==(const Keypoint&) const = default;
};

using Descriptor = std::array<std::uint64_t, 4>;

inline int HammingDistance(const Descriptor& a, const Descriptor& b) {
  return std::popcount(a[0] ^ b[0]) + std::popcount(a[1] ^ b[1]) + std::popcount(a[2] ^ b[2]) +
         std::popcount(a[3] ^ b[3]);
}

// The features of one image; the two vectors have the same length.
struct Features {
  std::vector<Keypoint> keypoints;
  std::vector<Descriptor> descriptors;

  std::size_t size() const { return keypoints.size(); }
  bool operator==(const Features&) const = default;
};

// What extraction used; stored with a map so that queries are extracted alike.
struct OrbParameters {
  int num_features = 2000;
  int num_levels = 8;
  double scale_factor = 1.2;
  int fast_threshold = 20;      // first try in a cell
  int min_fast_threshold = 7;   // second try, where the first finds nothing

  bool operator==(const OrbParameters&) const = default;

  // Scale of an octave against full resolution.
  double Scale(int octave) const {
    double scale = 1.0;
    for (int i = 0; i < octave; ++i) scale *= scale_factor;
    return scale;
  }
};

}  // namespace cairn::image

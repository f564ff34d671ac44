// ORB keypoints and their 256-bit descriptors (Rublee et al., "ORB: an efficient alternative to SIFT or SURF", 2011).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/status.h"

namespace cairn::image {

// In pixels of the full-resolution undistorted image, whatever pyramid level it was found at.
struct Keypoint {
  float x_px = 0.0f;
  float y_px = 0.0f;
  float angle_rad = 0.0f;   // of the intensity centroid, in [-pi, pi)
  std::uint8_t octave = 0;  // pyramid level; the scale is scale_factor^octave

  bool operator==(const Keypoint&) const = default;
};

// Coordinates are kept to 1/32 px, far finer than a corner can be found: map files then hold them in 16 bits.
inline float KeptPosition(float position_px) { return std::max(0.0f, std::round(position_px * 32.0f) / 32.0f); }

// Byte i of ORB's 32 bytes is byte i % 8 (counted from the least significant) of word i / 8.
using Descriptor = std::array<std::uint64_t, 4>;

// Number of differing bits, 0 to 256. Baseline x86-64 has no population count instruction, so bits are counted in
// parallel within each word (Warren, Hacker's Delight, ch. 5) and the bytes of all four words summed at once. Loops
// over many descriptors are faster with HammingDistances() in image/hamming.h.
inline int HammingDistance(const Descriptor& a, const Descriptor& b) {
  std::uint64_t byte_counts = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    std::uint64_t x = a[i] ^ b[i];
    x -= (x >> 1) & 0x5555555555555555ull;
    x = (x & 0x3333333333333333ull) + ((x >> 2) & 0x3333333333333333ull);
    byte_counts += (x + (x >> 4)) & 0x0F0F0F0F0F0F0F0Full;
  }
  // At most 32 per byte; pairs of bytes first, as 256 does not fit in one.
  byte_counts = (byte_counts & 0x00FF00FF00FF00FFull) + ((byte_counts >> 8) & 0x00FF00FF00FF00FFull);
  return static_cast<int>((byte_counts * 0x0001000100010001ull) >> 48);
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
  int fast_threshold = 20;     // first try in a cell
  int min_fast_threshold = 7;  // second try, where the first finds nothing

  bool operator==(const OrbParameters&) const = default;

  // InvalidArgument naming the first parameter that makes no sense.
  absl::Status Validate() const;

  // Scale of an octave against full resolution.
  double Scale(int octave) const {
    double scale = 1.0;
    for (int i = 0; i < octave; ++i) scale *= scale_factor;
    return scale;
  }
};

}  // namespace cairn::image

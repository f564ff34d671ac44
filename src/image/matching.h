// Matching of ORB features: a grid for radius queries, the best two of a set of candidates, ratio test, mutual check
// and the histogram of rotations.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "base/status.h"
#include "image/feature.h"
#include "image/segment_kernel.h"

namespace cairn::image {

inline constexpr std::uint32_t kNoFeature = std::numeric_limits<std::uint32_t>::max();

// Feature `a` of one image and feature `b` of another.
struct FeatureMatch {
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  int distance = 0;  // Hamming, in bits

  bool operator==(const FeatureMatch&) const = default;
};

struct MatchOptions {
  int max_distance = 50;       // bits; a match may not be farther
  double max_ratio = 0.75;     // best distance at most this share of the second best; 1: no such test
  bool mutual = true;          // the best match of b among all of a must be a
  bool check_rotation = true;  // drop pairs off the main modes of the rotation between the images

  absl::Status Validate() const;
};

// The nearest and the second nearest of some candidates. A tie goes to the candidate given first.
struct BestTwo {
  std::uint32_t index = kNoFeature;  // kNoFeature: there was no candidate
  int distance = 257;
  int second_distance = 257;  // 257: there was no second candidate

  void Add(std::uint32_t candidate, int candidate_distance) {
    if (candidate_distance < distance) {
      second_distance = distance;
      distance = candidate_distance;
      index = candidate;
    } else if (candidate_distance < second_distance) {
      second_distance = candidate_distance;
    }
  }
  // True if the nearest is near enough and stands out from the second.
  bool Accept(int max_distance, double max_ratio) const {
    return index != kNoFeature && distance <= max_distance &&
           (max_ratio >= 1.0 || second_distance > 256 || distance <= max_ratio * second_distance);
  }
};

// Among descriptors[i] for i in `candidates`.
BestTwo FindBestTwo(const Descriptor& query, std::span<const Descriptor> descriptors,
                    std::span<const std::uint32_t> candidates);
// Among all of `descriptors`.
BestTwo FindBestTwo(const Descriptor& query, std::span<const Descriptor> descriptors);

// Every feature of `a` against every feature of `b`; at most one match per feature of `a` (and, if mutual, of `b`),
// sorted by `a`.
std::vector<FeatureMatch> MatchBruteForce(const Features& a, const Features& b, const MatchOptions& options = {});

// Drops the matches whose rotation angle_a - angle_b is not in one of the `keep_bins` fullest of `bins` bins; a bin
// with less than a tenth of the fullest one's matches is never kept. A neighbouring bin of a kept one counts as kept,
// so that a rotation at the border of two bins loses nothing.
std::vector<FeatureMatch> KeepConsistentRotations(std::span<const Keypoint> a, std::span<const Keypoint> b,
                                                  std::vector<FeatureMatch> matches, int bins = 30, int keep_bins = 3);

// The keypoints of one image in square cells. Copies what it needs: the keypoints may go.
class FeatureGrid {
 public:
  // Keypoints outside the image are put in the nearest border cell.
  FeatureGrid(std::span<const Keypoint> keypoints, int width_px, int height_px, int cell_px = 16);
  FeatureGrid() = default;

  // Indices of the keypoints within the circle around (x_px, y_px), of an octave in [min_octave, max_octave], in a
  // fixed order (by cell, then index). Replaces the content of `out`.
  void Query(double x_px, double y_px, double radius_px, int min_octave, int max_octave,
             std::vector<std::uint32_t>* out) const;
  std::vector<std::uint32_t> Query(double x_px, double y_px, double radius_px, int min_octave = 0,
                                   int max_octave = 255) const;
  // Likewise those not further than half_width_px from the segment between two positions, each once.
  void QuerySegment(double begin_x_px, double begin_y_px, double end_x_px, double end_y_px, double half_width_px,
                    int min_octave, int max_octave, std::vector<std::uint32_t>* out) const;

  std::size_t size() const { return entries_.size(); }

 private:
  int columns_ = 0;
  int rows_ = 0;
  double inverse_cell_ = 0.0;              // cells per pixel
  std::vector<std::uint32_t> cell_begin_;  // columns_ * rows_ + 1 positions in entries_
  std::vector<internal::GridEntry> entries_;
};

// Where a feature of `a` is expected in image b, and which octaves are plausible there.
struct FeatureWindow {
  std::uint32_t feature = 0;  // index in a
  double x_px = 0.0;          // in image b
  double y_px = 0.0;
  double radius_px = 0.0;
  int min_octave = 0;
  int max_octave = 255;
};

// Each windowed feature of `a` against the features of `b` inside its window; `grid_b` holds b's keypoints. With
// options.mutual, of several features that choose the same b the nearest keeps it. Sorted by the order of `windows`.
std::vector<FeatureMatch> MatchInWindows(const Features& a, std::span<const FeatureWindow> windows, const Features& b,
                                         const FeatureGrid& grid_b, const MatchOptions& options = {});

}  // namespace cairn::image

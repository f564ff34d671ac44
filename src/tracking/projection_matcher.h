// Matching by projection: map points are projected with a known pose, and each is compared with the features near where
// it should appear (Mur-Artal, Montiel, Tardos, "ORB-SLAM: a versatile and accurate monocular SLAM system", T-RO 2015,
// Sec. V-D).
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "base/status.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"
#include "image/feature.h"
#include "image/matching.h"
#include "map/entities.h"

namespace cairn::tracking {

// What is matched against: the features of an image, and the grid over them. Refers to them; they must outlive it.
struct FeatureView {
  const Pinhole& pinhole;
  const image::Features& features;
  const image::FeatureGrid& grid;
};

// Further descriptors of a list of map points: those of all observations, say, where the typical one is not enough.
// Point i of the list has descriptors[begin[i]] to descriptors[begin[i + 1] - 1].
struct DescriptorLists {
  std::vector<std::uint32_t> begin = {0};
  std::vector<image::Descriptor> descriptors;

  std::size_t size() const { return begin.size() - 1; }
  std::span<const image::Descriptor> of(std::size_t point) const {
    return std::span(descriptors).subspan(begin[point], begin[point + 1] - begin[point]);
  }
  void Close() { begin.push_back(static_cast<std::uint32_t>(descriptors.size())); }  // ends the list of one point
};

// Search radii at octave 0: of a point seen from the front, and from aside.
inline constexpr double kFrontalRadiusPx = 2.5;
inline constexpr double kObliqueRadiusPx = 4.0;

struct ProjectionOptions {
  double radius_factor = 1.0;         // of the search radius, which grows with the octave's scale
  int max_distance = 100;             // Hamming, bits
  double max_ratio = 0.9;             // best against second best of the same octave; 1: no such test
  double max_viewing_angle_deg = 60;  // between the ray and the mean direction the point was seen from
  double distance_slack = 1.25;       // beyond the distances in which the camera finds the point (map/viewing.h)
  int octave_slack = 1;               // features of octaves that differ by more from the predicted one are left out

  absl::Status Validate() const;
};

// Where and how a point should appear.
struct PointProjection {
  Vector2d pixel = Vector2d::Zero();
  double distance = 0.0;  // from the camera's centre, map units
  double viewing_cosine = 0.0;
  int octave = 0;  // predicted
  double radius_px = 0.0;
};

// Nothing if the point is behind the camera, outside the image, out of the range of distances or seen too far from
// aside.
std::optional<PointProjection> PredictPoint(const Pinhole& pinhole, const SE3& camera_from_map,
                                            const map::MapPoint& point, const image::OrbParameters& orb,
                                            const ProjectionOptions& options = {});

// The octave at which a camera of this focal length is to find the point from a distance (map/viewing.h); within [0,
// num_levels - 1].
int PredictOctave(const map::MapPoint& point, double distance, double focal_px, const image::OrbParameters& orb);

struct PointMatch {
  std::uint32_t point = 0;    // index into the points given
  std::uint32_t feature = 0;  // index into the features
  int distance = 0;           // Hamming, bits

  bool operator==(const PointMatch&) const = default;
};

struct ProjectionMatches {
  std::vector<PointMatch> matches;     // ascending by point; each feature at most once: the nearest point has it
  std::vector<std::uint32_t> visible;  // the points that should appear in the image, ascending
};

// Points that are null are passed over. `taken`, if not empty, has an entry per feature; features with 1 are left out.
// `descriptors`, if given, has a list per point and replaces the points' typical descriptors (unless a list is empty).
ProjectionMatches MatchByProjection(const FeatureView& view, const SE3& camera_from_map,
                                    std::span<const map::MapPoint* const> points, const image::OrbParameters& orb,
                                    const ProjectionOptions& options = {}, std::span<const std::uint8_t> taken = {},
                                    const DescriptorLists* descriptors = nullptr);

}  // namespace cairn::tracking

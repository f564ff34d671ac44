#include "mapping/new_points.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "geometry/triangulation.h"
#include "image/hamming.h"
#include "image/matching.h"

namespace cairn::mapping {
namespace {

constexpr double kMaxRollErrorRad = 0.7;  // of keypoint orientations against the roll that the poses tell
constexpr int kCells = 8;                 // per side of the image
constexpr int kOctaves = 2;               // by which the two features of a match may differ

Vector2d PixelOf(const image::Keypoint& keypoint) { return {keypoint.x_px, keypoint.y_px}; }

struct Candidate {
  std::uint32_t feature_a = 0;
  std::uint32_t feature_b = 0;
  int distance = 0;
};

// Two keyframes, a (the new one) and b, and what relates them.
struct Pair {
  const map::Keyframe& a;
  const map::Keyframe& b;
  const Pinhole& pinhole_a;
  const Pinhole& pinhole_b;
  SE3 b_from_a;
  Matrix3d rotation;      // of b_from_a
  double roll_rad = 0.0;  // by which directions in image a turn in image b
};

struct Segment {
  Vector2d begin, end;
};

// Where the ray of a pixel appears in b for inverse depths between `low` and `high`; nothing if outside the image.
std::optional<Segment> EpipolarSegment(const Pair& pair, const Vector3d& ray, double low, double high) {
  // With p(w) = R ray + w t, w the inverse depth; z must stay positive over the range.
  const Vector3d& t = pair.b_from_a.translation();
  const Vector3d base = pair.rotation * ray;
  constexpr double kMinZ = 0.05;
  if (base.z() + low * t.z() < kMinZ) {
    if (t.z() <= 0.0) return std::nullopt;
    low = (kMinZ - base.z()) / t.z();
  }
  if (base.z() + high * t.z() < kMinZ) {
    if (t.z() >= 0.0) return std::nullopt;
    high = (kMinZ - base.z()) / t.z();
  }
  if (!(low < high)) return std::nullopt;
  Segment segment{pair.pinhole_b.Project(base + low * t), pair.pinhole_b.Project(base + high * t)};
  // Liang-Barsky clipping to the image.
  const Vector2d direction = segment.end - segment.begin;
  double from = 0.0, to = 1.0;
  const double bounds[2] = {static_cast<double>(pair.pinhole_b.width_px),
                            static_cast<double>(pair.pinhole_b.height_px)};
  for (int axis = 0; axis < 2; ++axis) {
    for (const auto& [p, q] : {std::pair(-direction[axis], segment.begin[axis]),
                               std::pair(direction[axis], bounds[axis] - segment.begin[axis])}) {
      if (std::abs(p) < 1e-12) {
        if (q < 0.0) return std::nullopt;
      } else if (p < 0.0) {
        from = std::max(from, q / p);
      } else {
        to = std::min(to, q / p);
      }
    }
  }
  if (from > to) return std::nullopt;
  return Segment{segment.begin + from * direction, segment.begin + to * direction};
}

double WrapAngle(double angle) { return std::remainder(angle, 2.0 * std::numbers::pi); }

class EpipolarMatcher {
 public:
  EpipolarMatcher(const Pair& pair, const image::OrbParameters& orb, const TriangulationOptions& options)
      : pair_(pair), options_(options) {
    for (int octave = 0; octave < orb.num_levels; ++octave) sigma_.push_back(orb.Scale(octave));
    // Only features that have no point can be matched.
    std::vector<image::Keypoint> open;
    for (std::uint32_t i = 0; i < pair.b.points.size(); ++i) {
      if (pair.b.points[i]) continue;
      open.push_back(pair.b.keypoints()[i]);
      open_.push_back(i);
    }
    grid_b_ = image::FeatureGrid(open, pair.pinhole_b.width_px, pair.pinhole_b.height_px);
  }

  double Sigma(int octave) const { return sigma_[static_cast<std::size_t>(octave)] + options_.extra_sigma_px; }

  std::optional<Candidate> Match(std::uint32_t feature, double low, double high) {
    const image::Keypoint& keypoint = pair_.a.keypoints()[feature];
    const Vector3d ray = pair_.pinhole_a.Unproject(PixelOf(keypoint));
    const auto segment = EpipolarSegment(pair_, ray, low, high);
    if (!segment) return std::nullopt;
    const Vector2d along = segment->end - segment->begin;
    const double length = along.norm();
    const Vector2d direction = length > 1e-9 ? Vector2d(along / length) : Vector2d(1.0, 0.0);
    const Vector2d normal(-direction.y(), direction.x());
    const int coarsest = std::min(keypoint.octave + kOctaves, static_cast<int>(sigma_.size()) - 1);
    // Beyond its ends by the three sigmas that are allowed below.
    const double widest = Sigma(coarsest), beyond = 3.0 * widest;
    const double half_width = std::sqrt(options_.max_epipolar_chi_square) * widest;
    const Vector2d begin = segment->begin - beyond * direction, end = segment->end + beyond * direction;
    grid_b_.QuerySegment(begin.x(), begin.y(), end.x(), end.y(), half_width, keypoint.octave - kOctaves,
                         keypoint.octave + kOctaves, &nearby_);
    fitting_.clear();
    for (const std::uint32_t in_grid : nearby_) {
      const std::uint32_t other = open_[in_grid];
      const image::Keypoint& candidate = pair_.b.keypoints()[other];
      const Vector2d offset = PixelOf(candidate) - segment->begin;
      const double sigma = Sigma(candidate.octave);
      const double across = normal.dot(offset), position = direction.dot(offset);
      if (across * across > options_.max_epipolar_chi_square * sigma * sigma) continue;
      if (position < -3.0 * sigma || position > length + 3.0 * sigma) continue;
      if (std::abs(WrapAngle(candidate.angle_rad - keypoint.angle_rad - pair_.roll_rad)) > kMaxRollErrorRad) continue;
      fitting_.push_back(other);
    }
    distances_.resize(fitting_.size());
    image::HammingDistancesAt(pair_.a.descriptors()[feature], pair_.b.descriptors().data(), fitting_.data(),
                              fitting_.size(), distances_.data());
    image::BestTwo best;
    for (std::size_t i = 0; i < fitting_.size(); ++i) {
      const std::uint32_t other = fitting_[i];
      const int distance = distances_[i];
      // The double of a feature in another octave is no rival of it.
      if (best.index != image::kNoFeature && SamePlace(best.index, other)) {
        if (distance < best.distance) {
          best.distance = distance;
          best.index = other;
        }
        continue;
      }
      best.Add(other, distance);
    }
    if (!best.Accept(options_.max_distance, options_.max_ratio)) return std::nullopt;
    return Candidate{feature, best.index, best.distance};
  }

 private:
  bool SamePlace(std::uint32_t i, std::uint32_t j) const {
    return (PixelOf(pair_.b.keypoints()[i]) - PixelOf(pair_.b.keypoints()[j])).squaredNorm() < 4.0;
  }

  const Pair& pair_;
  image::FeatureGrid grid_b_;
  std::vector<std::uint32_t> open_;  // features in the grid
  const TriangulationOptions& options_;
  std::vector<double> sigma_;
  std::vector<std::uint32_t> nearby_, fitting_;
  std::vector<std::uint16_t> distances_;
};

bool Reprojects(const Pinhole& pinhole, const Vector3d& point_c, const image::Keypoint& keypoint, double sigma,
                double max_chi_square) {
  if (!(point_c.z() > 1e-6)) return false;
  return (pinhole.Project(point_c) - PixelOf(keypoint)).squaredNorm() <= max_chi_square * sigma * sigma;
}

// The point in the frame of a, if it passes every gate.
std::optional<Vector3d> Triangulate(const Pair& pair, const Candidate& match, const EpipolarMatcher& matcher,
                                    const image::OrbParameters& orb, const TriangulationOptions& options) {
  const image::Keypoint& ka = pair.a.keypoints()[match.feature_a];
  const image::Keypoint& kb = pair.b.keypoints()[match.feature_b];
  const Vector3d ray_a = pair.pinhole_a.Unproject(PixelOf(ka)), ray_b = pair.pinhole_b.Unproject(PixelOf(kb));
  const double parallax = AngleBetweenRad(pair.rotation * ray_a, ray_b);
  if (parallax < options.min_parallax_deg * std::numbers::pi / 180.0) return std::nullopt;
  const auto point_a = TriangulateTwoView(pair.b_from_a, ray_a, ray_b);
  if (!point_a) return std::nullopt;
  const Vector3d point_b = pair.b_from_a * *point_a;
  if (!Reprojects(pair.pinhole_a, *point_a, ka, matcher.Sigma(ka.octave), options.max_chi_square) ||
      !Reprojects(pair.pinhole_b, point_b, kb, matcher.Sigma(kb.octave), options.max_chi_square)) {
    return std::nullopt;
  }
  // The nearer view sees the patch larger.
  const double distance_ratio = point_b.norm() / point_a->norm();
  const double octave_ratio = orb.Scale(ka.octave) / orb.Scale(kb.octave);
  const double tolerance = 1.5 * orb.scale_factor;
  if (distance_ratio * tolerance < octave_ratio || distance_ratio > octave_ratio * tolerance) return std::nullopt;
  return point_a;
}

}  // namespace

std::vector<PointId> PointsFromDepths(map::Edit& edit, KeyframeId id, std::span<const KeypointDepth> depths,
                                      double map_per_direct) {
  std::vector<PointId> added;
  const SE3 map_from_camera = edit.keyframe(id).camera_from_map.Inverse();
  const Pinhole pinhole = edit.pinhole(edit.keyframe(id).camera);
  for (std::uint32_t i = 0; i < depths.size(); ++i) {
    if (!depths[i].known() || edit.keyframe(id).points[i]) continue;
    const double z = map_per_direct / depths[i].inverse_depth;
    const PointId point =
        edit.AddPoint(map_from_camera * (z * pinhole.Unproject(PixelOf(edit.keyframe(id).keypoints()[i]))));
    edit.AddObservation(point, id, i);
    edit.UpdatePoint(point);
    added.push_back(point);
  }
  return added;
}

DepthRange DepthRangeOf(const map::Edit& edit, KeyframeId id) {
  const map::Keyframe& keyframe = edit.keyframe(id);
  std::vector<double> depths;
  for (const PointId point : keyframe.points) {
    if (!point) continue;
    const double z = (keyframe.camera_from_map * edit.point(point).position).z();
    if (z > 0.0) depths.push_back(z);
  }
  if (depths.size() < 10) return {};
  std::sort(depths.begin(), depths.end());
  const double near = depths[depths.size() / 20], far = depths[depths.size() - 1 - depths.size() / 20];
  return {0.2 / far, 2.0 / near, depths[depths.size() / 2]};
}

std::vector<std::uint8_t> CoveredFeatures(const map::Edit& edit, KeyframeId id, int points_per_cell, int min_age) {
  const map::Keyframe& keyframe = edit.keyframe(id);
  const Pinhole& pinhole = edit.pinhole(keyframe.camera);
  std::vector<std::uint8_t> covered(keyframe.points.size(), 0);
  if (points_per_cell <= 0) return covered;
  std::vector<int> points_in(kCells * kCells, 0);
  const auto cell_of = [&](std::size_t feature) {
    const image::Keypoint& keypoint = keyframe.keypoints()[feature];
    const int x = std::clamp(static_cast<int>(keypoint.x_px * kCells / pinhole.width_px), 0, kCells - 1);
    const int y = std::clamp(static_cast<int>(keypoint.y_px * kCells / pinhole.height_px), 0, kCells - 1);
    return static_cast<std::size_t>(y * kCells + x);
  };
  for (std::size_t i = 0; i < covered.size(); ++i) {
    const PointId point = keyframe.points[i];
    if (!point) continue;
    const auto age = id.value() - edit.point(point).observations.front().keyframe.value();
    if (static_cast<int>(age) >= min_age) ++points_in[cell_of(i)];
  }
  for (std::size_t i = 0; i < covered.size(); ++i) covered[i] = points_in[cell_of(i)] >= points_per_cell ? 1 : 0;
  return covered;
}

std::vector<PointId> TriangulateWith(map::Edit& edit, KeyframeId id, std::span<const KeyframeId> neighbours,
                                     std::span<const KeypointDepth> depths, double map_per_direct,
                                     const DepthRange& range, const TriangulationOptions& options) {
  std::vector<PointId> added;
  if (!range.valid()) return added;
  const std::vector<std::uint8_t> covered = CoveredFeatures(edit, id, options.covered_points, options.covered_age);
  const image::OrbParameters& orb = edit.info().orb;
  for (const KeyframeId neighbour_id : neighbours) {
    if (neighbour_id == id) continue;
    std::vector<std::pair<Candidate, Vector3d>> accepted;
    {
      const map::Keyframe& a = edit.keyframe(id);
      const map::Keyframe& b = edit.keyframe(neighbour_id);
      Pair pair{a,
                b,
                edit.pinhole(a.camera),
                edit.pinhole(b.camera),
                b.camera_from_map * a.camera_from_map.Inverse(),
                Matrix3d(),
                0.0};
      pair.rotation = pair.b_from_a.RotationMatrix();
      if (pair.b_from_a.translation().norm() < options.min_baseline_share * range.median_depth) continue;
      pair.roll_rad = std::atan2(pair.rotation(1, 0) - pair.rotation(0, 1), pair.rotation(0, 0) + pair.rotation(1, 1));
      EpipolarMatcher matcher(pair, orb, options);

      std::vector<Candidate> best_of_b(b.keypoints().size(), Candidate{0, 0, 257});
      for (std::uint32_t i = 0; i < a.keypoints().size(); ++i) {
        if (a.points[i] || covered[i]) continue;
        double low = range.min_inverse, high = range.max_inverse;
        if (i < depths.size() && depths[i].known()) {
          const double inverse = depths[i].inverse_depth / map_per_direct;
          // Wide, so that a wrong relative scale cannot confirm itself.
          const double slack = std::max(0.25, 4.0 * std::sqrt(depths[i].variance) / depths[i].inverse_depth);
          low = inverse * std::max(0.0, 1.0 - slack);
          high = inverse * (1.0 + slack);
        }
        const auto match = matcher.Match(i, low, high);
        if (match && match->distance < best_of_b[match->feature_b].distance) best_of_b[match->feature_b] = *match;
      }
      for (const Candidate& match : best_of_b) {
        if (match.distance > 256) continue;
        if (const auto point = Triangulate(pair, match, matcher, orb, options)) accepted.emplace_back(match, *point);
      }
    }
    const SE3 map_from_a = edit.keyframe(id).camera_from_map.Inverse();
    for (const auto& [match, point_a] : accepted) {
      const PointId point = edit.AddPoint(map_from_a * point_a);
      edit.AddObservation(point, id, match.feature_a);
      edit.AddObservation(point, neighbour_id, match.feature_b);
      edit.UpdatePoint(point);
      added.push_back(point);
    }
  }
  return added;
}

}  // namespace cairn::mapping

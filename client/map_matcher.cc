#include "client/map_matcher.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/median.h"
#include "client/query_image.h"
#include "image/matching.h"
#include "image/orb_extractor.h"
#include "optimization/pose_refinement.h"
#include "tracking/map_bend.h"
#include "tracking/view_support.h"

namespace cairn::client {
namespace {

constexpr double kWideSearch = 3.0;    // after a loss, in search radii
constexpr double kSearchSigmas = 2.5;  // the radius covers as many standard deviations of the expectation

// How much wider than usual the search must be for what the expectation leaves open.
double RadiusFactor(const Expectation& expected, const Pinhole& pinhole, double usual_px) {
  if (expected.after_loss) return kWideSearch;
  const double depth = std::max(expected.place.median_depth, 1e-9);
  const double sigma_px = pinhole.fx_px * std::hypot(expected.translation_sigma / depth, expected.rotation_sigma_rad);
  return std::clamp(kSearchSigmas * sigma_px / usual_px, 1.0, kWideSearch);
}

}  // namespace

absl::Status MapMatcherOptions::Validate() const {
  if (num_features < 0) return absl::InvalidArgumentError("map matcher: num_features must not be negative");
  if (num_features_followed < local_map.min_inliers) {
    return absl::InvalidArgumentError("map matcher: num_features_followed must not be below local_map.min_inliers");
  }
  if (!(min_support >= 0.0 && min_support < 1.0)) {
    return absl::InvalidArgumentError("map matcher: min_support must be in [0, 1)");
  }
  if (!(min_inlier_share >= 0.0 && min_inlier_share < 1.0)) {
    return absl::InvalidArgumentError("map matcher: min_inlier_share must be in [0, 1)");
  }
  if (min_inliers_after_loss < local_map.min_inliers) {
    return absl::InvalidArgumentError("map matcher: min_inliers_after_loss must not be below local_map.min_inliers");
  }
  CAIRN_RETURN_IF_ERROR(local_map.Validate());
  return relocalizer.Validate();
}

std::optional<Place> Place::In(const map::Snapshot& before, const map::Snapshot& after, double* scale) const {
  *scale = 1.0;
  const map::Keyframe* there = after.keyframes().Find(reference);
  const map::Keyframe* here = before.keyframes().Find(reference);
  if (there == nullptr || here == nullptr) return std::nullopt;
  Place place = *this;
  // Along the chain of joins: the component may have been joined to one that was joined to a third.
  for (ComponentId at = component; at != there->component;) {
    const auto found = after.components().find(at);
    if (found == after.components().end() || !found->second.joined) return std::nullopt;
    *scale *= found->second.joined->into_from_component.scale();
    at = found->second.joined->into;
  }
  place.component = there->component;
  const SE3 keyframe_from_camera = here->camera_from_map * map_from_camera;
  place.map_from_camera = there->camera_from_map.Inverse() * Scaled(keyframe_from_camera, *scale);
  place.median_depth *= *scale;
  place.bend.translation *= *scale;
  std::erase_if(place.seen, [&](PointId id) { return !after.points().Contains(id); });
  return place;
}

absl::StatusOr<ImageFeatures> MapMatcher::Extract(const tracking::MapView& view, const cv::Mat& undistorted,
                                                  bool all) const {
  const image::OrbExtractor extractor(view.map().info().orb);
  ImageFeatures image;
  const int most = options_.num_features > 0 ? options_.num_features : extractor.parameters().num_features;
  const int wanted = all ? most : std::min(most, options_.num_features_followed);
  CAIRN_ASSIGN_OR_RETURN(image.features, extractor.Extract(undistorted, wanted));
  image.in_image = image.features.keypoints;
  CorrectLens(view.map(), undistorter_->camera(), undistorter_->pinhole(), &image.features);
  return image;
}

Sighting MapMatcher::ToSighting(const tracking::MapView& view, const ImageFeatures& image,
                                const tracking::TrackedView& tracked) const {
  const map::Snapshot& map = view.map();
  Sighting sighting;
  sighting.found = true;
  sighting.place.component = map.keyframe(tracked.reference).component;
  sighting.place.map_from_camera = tracked.camera_from_map.Inverse();
  sighting.place.reference = tracked.reference;
  sighting.place.median_depth = tracked.median_depth;
  sighting.place.bend = tracking::BendAround(map, tracked.reference);
  sighting.calibration = CalibrationBy(map, image, tracked);
  const bool doubted = sighting.calibration && sighting.calibration->Contradicts();
  const Matrix6d covariance =
      doubted ? optimization::CoverFocal(tracked.camera_from_map, tracked.covariance, *sighting.calibration)
              : tracked.covariance;
  sighting.covariance = optimization::CovarianceOfInverse(tracked.camera_from_map, covariance);
  sighting.inliers = tracked.inliers;
  sighting.residual_rms = tracked.residual_rms;
  for (std::size_t i = 0; i < tracked.points.size(); ++i) {
    if (!tracked.points[i]) continue;
    sighting.place.seen.push_back(tracked.points[i]);
    const double depth = (tracked.camera_from_map * map.point(tracked.points[i]).position).z();
    if (!(depth > 0.0)) continue;
    const image::Keypoint& keypoint = image.in_image[i];
    sighting.depths.push_back({keypoint.x_px, keypoint.y_px, static_cast<float>(1.0 / depth), 0.0f});
  }
  return sighting;
}

std::optional<optimization::FocalEstimate> MapMatcher::CalibrationBy(const map::Snapshot& map,
                                                                     const ImageFeatures& image,
                                                                     const tracking::TrackedView& tracked) const {
  std::vector<optimization::PoseObservation> observations;
  for (std::size_t i = 0; i < tracked.points.size(); ++i) {
    if (!tracked.points[i]) continue;
    const image::Keypoint& keypoint = image.features.keypoints[i];
    observations.push_back({map.point(tracked.points[i]).position, Vector2d(keypoint.x_px, keypoint.y_px),
                            map.info().orb.Scale(keypoint.octave)});
  }
  // They agree already: a few steps from where they do.
  optimization::PoseRefinementOptions few;
  few.rounds = 1;
  few.iterations_per_round = 3;
  const auto estimate =
      optimization::EstimateFocal(undistorter_->pinhole(), tracked.camera_from_map, observations, few);
  if (!estimate.ok()) return std::nullopt;
  return *estimate;
}

double MapMatcher::SupportOf(const map::Snapshot& map, const ImageFeatures& image,
                             const tracking::TrackedView& tracked) const {
  const Pinhole& pinhole = undistorter_->pinhole();
  tracking::ViewSupport support(pinhole);
  for (std::size_t i = 0; i < tracked.points.size(); ++i) {
    if (!tracked.points[i]) continue;
    const image::Keypoint& keypoint = image.features.keypoints[i];
    support.Find({keypoint.x_px, keypoint.y_px});
  }
  for (const PointId id : tracked.visible) {
    const Vector3d point_c = tracked.camera_from_map * map.point(id).position;
    if (optimization::InFront(point_c)) support.Expect(pinhole.Project(point_c));
  }
  return support.Share();
}

Sighting MapMatcher::Match(const tracking::MapView& view, const ImageFeatures& image, const Expectation& expected,
                           StreamCache* cache) const {
  const Pinhole& pinhole = undistorter_->pinhole();
  const image::FeatureGrid grid(image.features.keypoints, pinhole.width_px, pinhole.height_px);
  tracking::LocalMapStart start;
  start.seed = {expected.place.map_from_camera.Inverse(), expected.translation_sigma, expected.rotation_sigma_rad};
  start.seen = expected.place.seen;
  start.anchor = expected.place.reference;
  start.median_depth = expected.place.median_depth;
  start.radius_factor = RadiusFactor(expected, pinhole, options_.local_map.search_radius_px);
  start.seen_first = !expected.after_loss && !expected.cautious;
  if (cache != nullptr) {
    if (cache->map != view.snapshot()) *cache = {view.snapshot(), {}};
    start.cache = &cache->points;
  }
  const tracking::TrackedView tracked =
      TrackLocalMap(view.map(), {pinhole, image.features, grid}, start, options_.local_map);
  const bool cautious = expected.after_loss || expected.cautious;
  const int needed = cautious ? options_.min_inliers_after_loss : options_.local_map.min_inliers;
  if (!tracked.tracked || tracked.inliers < needed || tracked.inliers < options_.min_inlier_share * tracked.matches) {
    Sighting miss;
    miss.reason = absl::StrCat("of ", image.features.size(), " features ", tracked.inliers,
                               " agree with the map around, at least ", needed, " needed");
    return miss;
  }
  const double support = SupportOf(view.map(), image, tracked);
  if (support < options_.min_support) {
    Sighting miss;
    miss.reason = absl::StrCat(
        tracked.inliers, " features agree with the map around, but too little of the view shows ", "what it should");
    miss.misplaced = true;
    return miss;
  }
  return ToSighting(view, image, tracked);
}

absl::StatusOr<Sighting> MapMatcher::Find(const tracking::MapView& view, const ImageFeatures& image) const {
  const map::Snapshot& map = view.map();
  const Pinhole& pinhole = undistorter_->pinhole();
  CAIRN_ASSIGN_OR_RETURN(const tracking::Relocalization found,
                         relocalizer_.Relocalize(map, *view.places(), pinhole, image.features));
  Sighting sighting;
  if (!found.localized) {
    sighting.reason = found.reason;
    return sighting;
  }
  // Many more points are seen than those that told the place.
  Expectation expected;
  std::vector<double> depths;
  for (const tracking::PointObservation& inlier : found.place.inliers) {
    expected.place.seen.push_back(inlier.point);
    depths.push_back((found.place.camera_from_map * map.point(inlier.point).position).z());
  }
  expected.place.map_from_camera = found.place.camera_from_map.Inverse();
  expected.place.reference = found.place.reference_keyframe;
  expected.place.component = map.keyframe(found.place.reference_keyframe).component;
  expected.place.median_depth = Median(depths);
  expected.place.bend = tracking::BendAround(map, found.place.reference_keyframe);
  sighting = Match(view, image, expected);
  if (sighting.misplaced) return sighting;
  // It has asked more than the matches around the pose.
  if (sighting.calibration && found.place.focal_factor != 1.0) sighting.calibration->scale = found.place.focal_factor;
  if (sighting.found && sighting.inliers >= static_cast<int>(found.place.inliers.size()) / 2) return sighting;
  sighting = {};
  sighting.found = true;
  sighting.place = std::move(expected.place);
  sighting.covariance = found.place.covariance;
  sighting.inliers = static_cast<int>(found.place.inliers.size());
  for (std::size_t i = 0; i < found.place.inliers.size(); ++i) {
    const image::Keypoint& keypoint = image.in_image[found.place.inliers[i].feature];
    if (depths[i] > 0.0) {
      sighting.depths.push_back({keypoint.x_px, keypoint.y_px, static_cast<float>(1.0 / depths[i]), 0.0f});
    }
  }
  return sighting;
}

}  // namespace cairn::client

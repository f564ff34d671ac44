#include "client/view_localizer.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "base/guarded.h"
#include "client/query_image.h"
#include "tracking/map_bend.h"

namespace cairn::client {
namespace {

using Clock = std::chrono::steady_clock;

double MillisecondsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

api::LocalizeStage ToApi(tracking::RelocalizationStage stage) {
  switch (stage) {
    case tracking::RelocalizationStage::kFeatures:
      return api::LocalizeStage::kFeatures;
    case tracking::RelocalizationStage::kCandidates:
      return api::LocalizeStage::kCandidates;
    case tracking::RelocalizationStage::kMatches:
      return api::LocalizeStage::kMatches;
    case tracking::RelocalizationStage::kPnp:
      return api::LocalizeStage::kPnp;
    case tracking::RelocalizationStage::kRefinement:
      return api::LocalizeStage::kRefinement;
    case tracking::RelocalizationStage::kRivals:
      return api::LocalizeStage::kRivals;
    case tracking::RelocalizationStage::kDone:
      return api::LocalizeStage::kDone;
  }
  return api::LocalizeStage::kFeatures;
}

absl::Status CheckQuery(const api::LocalizeQuery& query, const image::OrbParameters& orb) {
  CAIRN_RETURN_IF_ERROR(Annotate(query.camera.Validate(), "localize"));
  if (!query.features) return CheckImage(query.image, query.camera, "localize");
  if (!query.image.empty()) return absl::InvalidArgumentError("localize: give an image or its features, not both");
  return CheckFeatures(*query.features, orb);
}

api::LocatedPose ToApi(const map::Snapshot& map, const tracking::FoundPlace& place,
                       const tracking::MapErrorOptions& map_error) {
  api::LocatedPose pose;
  pose.map_from_camera = place.camera_from_map.Inverse();
  const tracking::MapError error =
      tracking::Larger(tracking::MapErrorOf(place.fit, map_error), tracking::BendAround(map, place.reference_keyframe));
  pose.covariance =
      place.covariance + tracking::CovarianceAtCamera(pose.map_from_camera, error.translation, error.rotation_rad);
  pose.focal_factor = place.focal_factor;
  pose.reference_keyframe = place.reference_keyframe;
  pose.inliers = place.fit.inliers;
  pose.component = map.keyframe(place.reference_keyframe).component;
  const auto& world_from_map = map.WorldFrom(pose.component);
  pose.world_is_metric = world_from_map.has_value();
  if (world_from_map) pose.world_per_map = world_from_map->scale();
  pose.world_from_camera = world_from_map ? world_from_map->TransformPose(pose.map_from_camera) : pose.map_from_camera;
  return pose;
}

// In the frames of all components that it may be about.
absl::StatusOr<std::vector<tracking::PlacePrior>> ToPriors(const map::Snapshot& map, const api::PosePrior& prior) {
  const std::vector<ComponentId> components = map.LiveComponents();
  std::vector<tracking::PlacePrior> priors;
  const auto add = [&](ComponentId component) {
    priors.push_back({component, prior.map_from_camera, prior.position_sigma, prior.rotation_sigma_rad});
    return priors.back().Validate();
  };
  if (prior.component) {
    if (std::ranges::find(components, prior.component) == components.end()) {
      return absl::InvalidArgumentError(
          absl::StrCat("localize: the prior is in component ", prior.component.value(), ", which the map has not"));
    }
    CAIRN_RETURN_IF_ERROR(add(prior.component));
    return priors;
  }
  for (const ComponentId component : components) {
    const auto& world_from_map = map.WorldFrom(component);
    if (!world_from_map) continue;
    CAIRN_RETURN_IF_ERROR(add(component));
    priors.back().map_from_camera = world_from_map->Inverse().TransformPose(prior.map_from_camera);
    priors.back().translation_sigma /= world_from_map->scale();
  }
  if (priors.empty() && components.size() > 1) {
    return absl::InvalidArgumentError(absl::StrCat("localize: the map has ", components.size(),
                                                   " components and none is aligned to the world: say in which one's "
                                                   "frame the prior is"));
  }
  if (priors.empty() && components.size() == 1) CAIRN_RETURN_IF_ERROR(add(components[0]));
  return priors;
}

}  // namespace

absl::Status LocalLocalizerOptions::Validate() const {
  if (num_features < 0) return absl::InvalidArgumentError("localizer: num_features must not be negative");
  CAIRN_RETURN_IF_ERROR(map_error.Validate());
  return relocalizer.Validate();
}

absl::StatusOr<api::LocalizeAnswer> ViewLocalizer::Localize(const tracking::MapView& view,
                                                            const api::LocalizeQuery& query) {
  return Guarded([&] { return Locate(view, query); });
}

absl::StatusOr<tracking::Relocalization> ViewLocalizer::FindImage(const tracking::MapView& view,
                                                                  const api::LocalizeQuery& query,
                                                                  const tracking::SearchArea& area,
                                                                  api::LocalizeAnswer* answer) {
  const map::Snapshot& map = view.map();
  const auto start = Clock::now();
  CAIRN_ASSIGN_OR_RETURN(const auto undistorter, undistorters_.For(query.camera));
  CAIRN_ASSIGN_OR_RETURN(const cv::Mat image, undistorter->Undistort(query.image));
  answer->extract_ms = MillisecondsSince(start);
  tracking::Relocalization found;
  for (const double scale : ScalesFor(map, undistorter->pinhole())) {
    const auto begin = Clock::now();
    CAIRN_ASSIGN_OR_RETURN(const QueryFeatures features,
                           ExtractQuery(map, *undistorter, image, scale, options_.num_features));
    answer->lens = features.lens;
    answer->extract_ms += MillisecondsSince(begin);
    const auto extracted = Clock::now();
    CAIRN_ASSIGN_OR_RETURN(found,
                           relocalizer_.Relocalize(map, *view.places(), features.pinhole, features.features, area));
    answer->locate_ms += MillisecondsSince(extracted);
    if (found.localized || !found.rivals.empty()) break;
  }
  return found;
}

absl::StatusOr<tracking::Relocalization> ViewLocalizer::FindFeatures(const tracking::MapView& view,
                                                                     const api::LocalizeQuery& query,
                                                                     const tracking::SearchArea& area,
                                                                     api::LocalizeAnswer* answer) {
  const auto start = Clock::now();
  image::Features features = query.features->features;
  const Pinhole& pinhole = query.features->pinhole;
  answer->lens = CorrectLens(view.map(), query.camera, pinhole, &features);
  auto found = relocalizer_.Relocalize(view.map(), *view.places(), pinhole, features, area);
  answer->locate_ms = MillisecondsSince(start);
  return found;
}

absl::StatusOr<api::LocalizeAnswer> ViewLocalizer::Locate(const tracking::MapView& view,
                                                          const api::LocalizeQuery& query) {
  const map::Snapshot& map = view.map();
  CAIRN_RETURN_IF_ERROR(CheckQuery(query, map.info().orb));
  if (view.places() == nullptr) {
    return absl::FailedPreconditionError("the map has no vocabulary, so that no place can be found in it");
  }
  api::LocalizeAnswer answer;
  answer.map_id = map.info().id;
  answer.revision = map.revision();
  answer.components = static_cast<int>(map.LiveComponents().size());

  tracking::SearchArea area;
  if (query.prior) {
    CAIRN_ASSIGN_OR_RETURN(area.priors, ToPriors(map, *query.prior));
  }

  CAIRN_ASSIGN_OR_RETURN(const tracking::Relocalization found, query.features ? FindFeatures(view, query, area, &answer)
                                                                              : FindImage(view, query, area, &answer));
  if (map.feature_cache() != nullptr) CAIRN_RETURN_IF_ERROR(map.feature_cache()->status());
  answer.localized = found.localized;
  answer.stage = ToApi(found.stage);
  answer.reason = found.reason;
  answer.focal_factor = found.place.focal_factor;
  answer.counts = {found.counts.features,    found.counts.candidates,     found.counts.word_matches,
                   found.counts.pnp_inliers, found.counts.guided_matches, found.counts.inliers};
  if (found.localized) static_cast<api::LocatedPose&>(answer) = ToApi(map, found.place, options_.map_error);
  for (const tracking::FoundPlace& rival : found.rivals) {
    answer.rivals.push_back(ToApi(map, rival, options_.map_error));
  }
  return answer;
}

}  // namespace cairn::client

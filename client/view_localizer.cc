#include "client/view_localizer.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "base/guarded.h"
#include "client/query_image.h"
#include "image/orb_extractor.h"

namespace cairn::client {
namespace {

constexpr std::size_t kKeptUndistorters = 4;
constexpr std::int64_t kKeptPixels = 50'000'000;  // of all of them, 6 bytes each; the last one is kept in any case

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
    case tracking::RelocalizationStage::kDone:
      return api::LocalizeStage::kDone;
  }
  return api::LocalizeStage::kFeatures;
}

absl::Status CheckQuery(const api::LocalizeQuery& query) {
  CAIRN_RETURN_IF_ERROR(Annotate(query.camera.Validate(), "localize"));
  return CheckImage(query.image, query.camera, "localize");
}

void FillPose(const map::Snapshot& map, const tracking::Relocalization& found, api::LocalizeAnswer* answer) {
  answer->map_from_camera = found.camera_from_map.Inverse();
  answer->covariance = found.covariance;
  answer->reference_keyframe = found.reference_keyframe;
  answer->component = map.keyframe(found.reference_keyframe).component;
  const auto& world_from_map = map.WorldFrom(answer->component);
  answer->world_is_metric = world_from_map.has_value();
  if (world_from_map) answer->world_per_map = world_from_map->scale();
  answer->world_from_camera =
      world_from_map ? world_from_map->TransformPose(answer->map_from_camera) : answer->map_from_camera;
}

}  // namespace

absl::Status LocalLocalizerOptions::Validate() const {
  if (num_features < 0) return absl::InvalidArgumentError("localizer: num_features must not be negative");
  return relocalizer.Validate();
}

std::shared_ptr<const image::Undistorter> ViewLocalizer::KnownUndistorter(const Camera& camera) {
  const std::lock_guard lock(mutex_);
  const auto known = std::find_if(undistorters_.begin(), undistorters_.end(),
                                  [&](const auto& undistorter) { return undistorter->camera() == camera; });
  if (known == undistorters_.end()) return nullptr;
  std::rotate(undistorters_.begin(), known, known + 1);
  return undistorters_.front();
}

// Others are answered meanwhile; two that ask with the same new camera at once make the same twice, and keep one.
absl::StatusOr<std::shared_ptr<const image::Undistorter>> ViewLocalizer::UndistorterFor(const Camera& camera) {
  if (auto known = KnownUndistorter(camera)) return known;
  CAIRN_ASSIGN_OR_RETURN(image::Undistorter made, image::Undistorter::Create(camera));
  auto undistorter = std::make_shared<const image::Undistorter>(std::move(made));
  if (auto known = KnownUndistorter(camera)) return known;
  std::vector<std::shared_ptr<const image::Undistorter>> dropped;  // freed without the lock
  const std::lock_guard lock(mutex_);
  undistorters_.insert(undistorters_.begin(), undistorter);
  std::int64_t pixels = 0;
  for (std::size_t i = 0; i < undistorters_.size(); ++i) {
    const Camera& kept = undistorters_[i]->camera();
    pixels += undistorters_[i]->identity() ? 0 : std::int64_t{kept.width_px} * kept.height_px;
    if (i == 0 || (i < kKeptUndistorters && pixels <= kKeptPixels)) continue;
    dropped.assign(undistorters_.begin() + static_cast<std::ptrdiff_t>(i), undistorters_.end());
    undistorters_.resize(i);
  }
  return undistorter;
}

absl::StatusOr<api::LocalizeAnswer> ViewLocalizer::Localize(const tracking::MapView& view,
                                                            const api::LocalizeQuery& query) {
  return Guarded([&] { return Locate(view, query); });
}

absl::StatusOr<api::LocalizeAnswer> ViewLocalizer::Locate(const tracking::MapView& view,
                                                          const api::LocalizeQuery& query) {
  CAIRN_RETURN_IF_ERROR(CheckQuery(query));
  const map::Snapshot& map = view.map();
  if (view.places() == nullptr) {
    return absl::FailedPreconditionError("the map has no vocabulary, so that no place can be found in it");
  }
  api::LocalizeAnswer answer;
  answer.map_id = map.info().id;
  answer.revision = map.revision();
  answer.components = static_cast<int>(map.LiveComponents().size());

  const auto start = Clock::now();
  CAIRN_ASSIGN_OR_RETURN(const auto undistorter, UndistorterFor(query.camera));
  CAIRN_ASSIGN_OR_RETURN(const cv::Mat image, undistorter->Undistort(query.image));
  const image::OrbExtractor extractor(map.info().orb);
  CAIRN_ASSIGN_OR_RETURN(image::Features features, extractor.Extract(image, options_.num_features));
  answer.lens = CorrectLens(map, *undistorter, &features);
  answer.extract_ms = MillisecondsSince(start);

  const auto extracted = Clock::now();
  CAIRN_ASSIGN_OR_RETURN(const tracking::Relocalization found,
                         relocalizer_.Relocalize(map, *view.places(), undistorter->pinhole(), features));
  answer.locate_ms = MillisecondsSince(extracted);
  answer.localized = found.localized;
  answer.stage = ToApi(found.stage);
  answer.reason = found.reason;
  answer.counts = {found.counts.features,    found.counts.candidates,     found.counts.word_matches,
                   found.counts.pnp_inliers, found.counts.guided_matches, found.counts.inliers};
  if (found.localized) FillPose(map, found, &answer);
  return answer;
}

}  // namespace cairn::client

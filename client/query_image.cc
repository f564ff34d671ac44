#include "client/query_image.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "image/orb_extractor.h"
#include "map/camera_identity.h"
#include "map/lens.h"

namespace cairn::client {
namespace {

// By so much finer pixels than the map's make little difference: two levels of a pyramid of 1.2.
constexpr double kFinerThanMap = 1.5;

// Pixel centres at integers.
Pinhole Resized(const Pinhole& pinhole, int width_px, int height_px) {
  const double x = static_cast<double>(width_px) / pinhole.width_px,
               y = static_cast<double>(height_px) / pinhole.height_px;
  return {width_px,
          height_px,
          x * pinhole.fx_px,
          y * pinhole.fy_px,
          x * (pinhole.cx_px + 0.5) - 0.5,
          y * (pinhole.cy_px + 0.5) - 0.5};
}

}  // namespace

absl::Status CheckImage(const cv::Mat& image, const Camera& camera, const char* who) {
  if (image.empty() || image.type() != CV_8UC1) {
    return absl::InvalidArgumentError(absl::StrCat(who, ": the image must be 8-bit grey (CV_8UC1) and not empty"));
  }
  if (image.cols != camera.width_px || image.rows != camera.height_px) {
    return absl::InvalidArgumentError(absl::StrCat(who, ": the image has ", image.cols, "x", image.rows,
                                                   " pixels, its camera ", camera.width_px, "x", camera.height_px));
  }
  return absl::OkStatus();
}

absl::Status CheckFeatures(const api::ImageFeatures& features, const image::OrbParameters& map_orb) {
  if (features.features.size() != features.features.descriptors.size()) {
    return absl::InvalidArgumentError("localize: there must be a descriptor for each keypoint");
  }
  image::OrbParameters orb = features.orb;
  orb.num_features = map_orb.num_features;
  if (orb == map_orb) return absl::OkStatus();
  const auto text = [](const image::OrbParameters& p) {
    return absl::StrCat(p.num_levels, " levels, scale ", p.scale_factor, ", thresholds ", p.fast_threshold, " and ",
                        p.min_fast_threshold);
  };
  return absl::FailedPreconditionError(absl::StrCat("localize: the features were extracted with ", text(orb),
                                                    ", those of the map with ", text(map_orb)));
}

double FinestFocalPx(const map::Snapshot& map) {
  double finest_px = 0.0;
  for (const auto& [id, camera] : map.cameras()) finest_px = std::max(finest_px, camera.pinhole.fx_px);
  return finest_px;
}

std::vector<double> ScalesFor(double finest_px, const Pinhole& pinhole) {
  if (finest_px <= 0.0 || pinhole.fx_px <= kFinerThanMap * finest_px) return {1.0};
  return {finest_px / pinhole.fx_px, 1.0};
}

absl::StatusOr<api::ImageFeatures> ExtractAt(const image::OrbParameters& orb, const Pinhole& pinhole,
                                             const cv::Mat& undistorted, double scale, int num_features) {
  api::ImageFeatures extracted;
  extracted.pinhole = pinhole;
  extracted.orb = orb;
  cv::Mat image = undistorted;
  if (scale < 1.0) {
    extracted.pinhole = Resized(pinhole, static_cast<int>(std::lround(scale * undistorted.cols)),
                                static_cast<int>(std::lround(scale * undistorted.rows)));
    const cv::Size size(extracted.pinhole.width_px, extracted.pinhole.height_px);
    cv::resize(undistorted, image, size, 0.0, 0.0, cv::INTER_AREA);
  }
  CAIRN_ASSIGN_OR_RETURN(extracted.features, image::OrbExtractor(orb).Extract(image, num_features));
  return extracted;
}

absl::StatusOr<QueryFeatures> ExtractQuery(const map::Snapshot& map, const image::Undistorter& undistorter,
                                           const cv::Mat& undistorted, double scale, int num_features) {
  CAIRN_ASSIGN_OR_RETURN(api::ImageFeatures extracted,
                         ExtractAt(map.info().orb, undistorter.pinhole(), undistorted, scale, num_features));
  QueryFeatures query{std::move(extracted.features), extracted.pinhole};
  query.lens = CorrectLens(map, undistorter.camera(), query.pinhole, &query.features);
  return query;
}

api::LensUse CorrectLens(const map::Snapshot& map, const Camera& camera, const Pinhole& pinhole,
                         image::Features* features) {
  bool corrects = false, knows = false;  // some camera's lens; a camera with this calibration
  for (const auto& [id, known] : map.cameras()) {
    corrects = corrects || known.lens;
    if (!map::SameLens(known.model, camera)) continue;
    knows = true;
    if (!known.lens) continue;
    // The correction is of directions, so that it holds at any resolution.
    map::MapCamera resized = known;
    resized.pinhole = pinhole;
    map::CorrectKeypoints(resized, features->keypoints);
    return api::LensUse::kCorrected;
  }
  return corrects && !knows ? api::LensUse::kOtherCalibration : api::LensUse::kNone;
}

}  // namespace cairn::client

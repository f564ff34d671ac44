#include "client/query_image.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

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

std::vector<double> ScalesFor(const map::Snapshot& map, const Pinhole& pinhole) {
  double finest_px = 0.0;
  for (const auto& [id, camera] : map.cameras()) finest_px = std::max(finest_px, camera.pinhole.fx_px);
  if (finest_px <= 0.0 || pinhole.fx_px <= kFinerThanMap * finest_px) return {1.0};
  return {finest_px / pinhole.fx_px, 1.0};
}

absl::StatusOr<QueryFeatures> ExtractQuery(const map::Snapshot& map, const image::Undistorter& undistorter,
                                           const cv::Mat& undistorted, double scale, int num_features) {
  QueryFeatures query;
  query.pinhole = undistorter.pinhole();
  cv::Mat image = undistorted;
  if (scale < 1.0) {
    query.pinhole = Resized(query.pinhole, static_cast<int>(std::lround(scale * undistorted.cols)),
                            static_cast<int>(std::lround(scale * undistorted.rows)));
    cv::resize(undistorted, image, cv::Size(query.pinhole.width_px, query.pinhole.height_px), 0.0, 0.0, cv::INTER_AREA);
  }
  const image::OrbExtractor extractor(map.info().orb);
  CAIRN_ASSIGN_OR_RETURN(query.features, extractor.Extract(image, num_features));
  query.lens = CorrectLens(map, undistorter.camera(), query.pinhole, &query.features);
  return query;
}

api::LensUse CorrectLens(const map::Snapshot& map, const Camera& camera, const Pinhole& pinhole,
                         image::Features* features) {
  api::LensUse use = api::LensUse::kNone;
  for (const auto& [id, known] : map.cameras()) {
    if (!known.lens) continue;
    use = api::LensUse::kOtherCalibration;
    if (!map::SameLens(known.model, camera)) continue;
    // The correction is of directions, so that it holds at any resolution.
    map::MapCamera resized = known;
    resized.pinhole = pinhole;
    map::CorrectKeypoints(resized, features->keypoints);
    return api::LensUse::kCorrected;
  }
  return use;
}

}  // namespace cairn::client

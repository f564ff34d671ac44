// What an image from outside must be before it is compared with a map: of its camera's size, undistorted, and its
// keypoints where the map's camera would have seen them.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "api/localizer.h"
#include "base/status.h"
#include "geometry/camera.h"
#include "image/feature.h"
#include "image/undistort.h"
#include "map/snapshot.h"

namespace cairn::client {

// InvalidArgument, behind `who`: not CV_8UC1, empty, or of another size than the camera.
absl::Status CheckImage(const cv::Mat& image, const Camera& camera, const char* who);

// InvalidArgument without features; FailedPrecondition if they were extracted otherwise than those of the map.
absl::Status CheckFeatures(const api::ImageFeatures& features, const image::OrbParameters& map_orb);

// The focal length of the finest of the map's cameras, pixels; 0: it has none.
double FinestFocalPx(const map::Snapshot& map);

// At which scales to look for an undistorted image in the map, the likeliest first: where its pixels are much finer
// than those of the map's cameras it is reduced to theirs, as what it shows beyond that the map does not know; at full
// size only as a second try, as a long lens sees from afar what they saw from near.
std::vector<double> ScalesFor(double map_finest_px, const Pinhole& pinhole);
inline std::vector<double> ScalesFor(const map::Snapshot& map, const Pinhole& pinhole) {
  return ScalesFor(FinestFocalPx(map), pinhole);
}

// Features of an undistorted image as `orb` says, at most `num_features` of them or as many as it says, where the image
// would be seen at this scale.
absl::StatusOr<api::ImageFeatures> ExtractAt(const image::OrbParameters& orb, const Pinhole& pinhole,
                                             const cv::Mat& undistorted, double scale, int num_features);

// Features of an undistorted image, and the pinhole in whose pixels they are.
struct QueryFeatures {
  image::Features features;
  Pinhole pinhole;
  api::LensUse lens = api::LensUse::kNone;
};
// At most `num_features` of them, or as many as the map's keyframes have if that is 0.
absl::StatusOr<QueryFeatures> ExtractQuery(const map::Snapshot& map, const image::Undistorter& undistorter,
                                           const cv::Mat& undistorted, double scale, int num_features);

// A camera that the map knows, by its calibration, and whose lens a session has corrected (map/lens.h): that of a query
// with the same calibration, be it at another resolution, is the same. `pinhole` is of the keypoints.
api::LensUse CorrectLens(const map::Snapshot& map, const Camera& camera, const Pinhole& pinhole,
                         image::Features* features);

}  // namespace cairn::client

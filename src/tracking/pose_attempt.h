// From matches of an image with a group of keyframes to a pose that is accepted, or the stage that failed: PnP in
// RANSAC, guided search over the local map in rounds of shrinking radius, each with motion-only bundle adjustment, and
// the evidence.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "base/status.h"
#include "geometry/pinhole.h"
#include "image/feature.h"
#include "map/snapshot.h"
#include "optimization/pose_refinement.h"
#include "tracking/group_matcher.h"
#include "tracking/place_index.h"
#include "tracking/relocalization.h"
#include "tracking/relocalizer_options.h"

namespace cairn::tracking {

// One image to be located; everything that all attempts share.
struct ImageQuery {
  const map::Snapshot& map;
  const PlaceIndex& places;
  const Pinhole& pinhole;
  const image::Features& features;
  image::FeatureGrid grid;
  PlaceIndex::Words words;

  double SigmaPx(std::uint32_t feature) const { return map.info().orb.Scale(features.keypoints[feature].octave); }
  optimization::PoseObservation Observation(const Vector3d& point, std::uint32_t feature) const {
    const image::Keypoint& keypoint = features.keypoints[feature];
    return {point, {keypoint.x_px, keypoint.y_px}, SigmaPx(feature)};
  }
};

// `matches` are with the group of `founder`, the most trustworthy first; `counts` has what is known of the image. The
// number of the attempt seeds its RANSAC. InvalidArgument: bad options.
absl::StatusOr<Relocalization> AttemptPose(const ImageQuery& query, KeyframeId founder,
                                           std::span<const GroupMatch> matches, std::uint64_t number,
                                           const RelocalizationCounts& counts, const RelocalizerOptions& options);

// Of an image that was missed: the calibration with which it would be accepted, told by its focal length.
struct CalibrationFit {
  double focal_factor = 1.0;  // what that of the query is to be multiplied by
  int inliers = 0;
  KeyframeId reference;
};
// `as_calibrated` of the matches agreed with the query's own.
std::optional<CalibrationFit> FitWithAnotherCalibration(const ImageQuery& query, std::span<const GroupMatch> matches,
                                                        int as_calibrated, const RelocalizerOptions& options);

}  // namespace cairn::tracking

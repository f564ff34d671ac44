// What a search for an image in a map comes to: a pose, several that fit as well, or the stage that failed.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/ids.h"
#include "geometry/se3.h"
#include "tracking/map_error.h"

namespace cairn::tracking {

// In order; kRivals: places were found, more than one that fits.
enum class RelocalizationStage { kFeatures, kCandidates, kMatches, kPnp, kRefinement, kRivals, kDone };

// Of the attempt that got furthest.
struct RelocalizationCounts {
  int features = 0;
  int candidates = 0;  // keyframes that share enough words
  int word_matches = 0;
  int pnp_inliers = 0;
  int guided_matches = 0;  // in the last round
  int inliers = 0;         // after refinement
  int visible = 0;         // points of the local map that should be in view
  int visible_cells = 0;   // of 8 x 8 in the image, those where at least three of these should be
  int cells = 0;           // of them, those that hold inliers
};

struct PointObservation {
  PointId point;
  std::uint32_t feature = 0;
};

// A place of the map that fits the image.
struct FoundPlace {
  SE3 camera_from_map;
  // Of (translation, rotation) as a left increment of map_from_camera, map units and radians, as the matches leave it,
  // the focal length with it where they doubt that: that the map errs there is not in it.
  Matrix6d covariance = Matrix6d::Zero();
  MapFit fit;
  // Where the matches contradict the calibration (optimization/focal_estimate.h): what its focal length should be
  // multiplied by. 1: they do not.
  double focal_factor = 1.0;
  KeyframeId reference_keyframe;          // that sees most of the inliers
  std::vector<PointObservation> inliers;  // ascending by point
};

struct Relocalization {
  bool localized = false;
  bool beyond_doubt = false;                                   // RelocalizerOptions::strong_support
  RelocalizationStage stage = RelocalizationStage::kFeatures;  // that failed, or kDone
  std::string reason;                                          // of a miss, for people
  RelocalizationCounts counts;

  FoundPlace place;  // if localized
  // If stage is kRivals, and not localized: the places that fit about as well, most inliers first.
  std::vector<FoundPlace> rivals;
};

}  // namespace cairn::tracking

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

// What the inliers say of the image's calibration: the factor by which its focal length would fit them better, with its
// standard deviation, and by how much the camera's centre would move with it, map units. Nothing if they leave it open.
struct FocalFit {
  double factor = 1.0;
  double sigma = 0.0;  // 0: open
  double shift = 0.0;

  // The focal length is not what the calibration says: by more than maps bend.
  bool contradicts() const;
  // It may not be: the pose may be off by `shift`.
  bool doubts() const;
};

// A place of the map that fits the image.
struct FoundPlace {
  SE3 camera_from_map;
  // Of (translation, rotation) as a left increment of map_from_camera, map units and radians, as the matches leave it:
  // that the map errs there is not in it.
  Matrix6d covariance = Matrix6d::Zero();
  MapFit fit;
  FocalFit focal;
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

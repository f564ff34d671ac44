// "Where is this camera?", asked the same way of a map file in this process or of a daemon. A miss says why.
#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "api/image_features.h"
#include "base/ids.h"
#include "base/status.h"
#include "base/time.h"
#include "geometry/camera.h"
#include "geometry/se3.h"

namespace cairn::api {

// Where the camera is thought to be: it narrows the search, and excludes what only looks alike. Standard deviations per
// axis, independent.
struct PosePrior {
  // In the frame of `component`, and its units; without one in the world frame of the components that are aligned, or
  // in the frame of the only one.
  SE3 map_from_camera;
  ComponentId component;
  double position_sigma = 0.0;  // infinite: unknown
  double rotation_sigma_rad = 0.0;
};

struct LocalizeQuery {
  cv::Mat image;  // CV_8UC1, raw as the camera gives it; empty with `features`
  Camera camera;  // of that image
  TimeNs time_ns = 0;
  std::optional<PosePrior> prior = std::nullopt;
  std::optional<ImageFeatures> features = std::nullopt;  // in place of the image
};

// The stages of a relocalization, in order; a miss names the one that failed. kRivals: the image fits several places
// about as well.
enum class LocalizeStage { kFeatures, kCandidates, kMatches, kPnp, kRefinement, kRivals, kDone };
const char* LocalizeStageName(LocalizeStage stage);

// What each stage had to work with, of the candidate that got furthest.
struct LocalizeCounts {
  int features = 0;
  int candidates = 0;  // keyframes that share enough words
  int word_matches = 0;
  int pnp_inliers = 0;
  int guided_matches = 0;
  int inliers = 0;  // after refinement
};

// Whether the lens that a session has found for a camera of the map (map format 3) was applied to the image.
enum class LensUse {
  kNone,              // the map corrects no lens
  kCorrected,         // the image's camera is one that the map corrects
  kOtherCalibration,  // the map corrects a lens, but of no camera with this calibration
};
const char* LensUseName(LensUse use);

// Where a camera is.
struct LocatedPose {
  SE3 map_from_camera;
  // The component in whose frame the pose is; positions of different components mean nothing to each other.
  ComponentId component;
  // The pose in the world frame; the same as map_from_camera while the component is not aligned.
  SE3 world_from_camera;
  double world_per_map = 1.0;    // scale of world_from_component
  bool world_is_metric = false;  // the component has been aligned
  // Of (translation, rotation) as a left increment of map_from_camera, in map units and radians: what the matches leave
  // open, and what the map errs there.
  Matrix6d covariance = Matrix6d::Zero();
  KeyframeId reference_keyframe;  // the one that shares most points
  int inliers = 0;                // points of the map that are seen where the pose puts them
  // Where these contradict the calibration: the factor by which its focal length should be longer. The covariance then
  // has in it by how much the pose would move. 1: they do not.
  double focal_factor = 1.0;
};

// With the pose, if localized.
struct LocalizeAnswer : LocatedPose {
  bool localized = false;
  LocalizeStage stage = LocalizeStage::kFeatures;  // reached; kDone if localized
  std::string reason;                              // of a miss, for people
  LocalizeCounts counts;
  // Of kRivals: the poses that fit about as well, at least two, most inliers first. Not one of them is the answer.
  std::vector<LocatedPose> rivals;

  int components = 0;  // that the map has
  std::string map_id;
  Revision revision = 0;
  LensUse lens = LensUse::kNone;
  double extract_ms = 0.0;
  double locate_ms = 0.0;
};

// One interface, two implementations: a map file in this process, and a daemon.
class Localizer {
 public:
  virtual ~Localizer() = default;

  // A miss is an answer, not an error. Errors: InvalidArgument (bad image or camera), Unavailable (no server),
  // DataLoss.
  virtual absl::StatusOr<LocalizeAnswer> Localize(const LocalizeQuery& query) = 0;
};

}  // namespace cairn::api

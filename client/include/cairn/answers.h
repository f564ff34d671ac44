/// \file
/// What a Localizer and a Tracker answer.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "cairn/export.h"
#include "cairn/pose.h"

CAIRN_BEGIN_NAMESPACE

/// The stages of finding a single image in a map, in order; a miss names the one that failed.
enum class LocalizeStage {
  kFeatures,    ///< the image has too few features: blank, dark, blurred
  kCandidates,  ///< no keyframe of the map looks like it
  kMatches,     ///< too few features match those of the keyframes that do
  kPnp,         ///< the matches agree on no pose
  kRefinement,  ///< the pose is not confirmed by the rest of the map around it
  kRivals,      ///< the image fits several places about as well
  kDone,        ///< found
};
/// "features", "place candidates", ...
CAIRN_API const char* LocalizeStageName(LocalizeStage stage) noexcept;

/// What each stage had to work with, of the candidate that got furthest.
struct LocalizeCounts {
  int features = 0;        ///< in the image
  int candidates = 0;      ///< keyframes that share enough words with it
  int word_matches = 0;    ///< features that match one of these
  int pnp_inliers = 0;     ///< that agree on a pose
  int guided_matches = 0;  ///< points of the map found where that pose puts them
  int inliers = 0;         ///< of these, after refinement
};

/// Whether the lens that the map has found for its camera was applied to the image.
enum class LensUse {
  kNone,              ///< the map corrects no lens
  kCorrected,         ///< the image's camera is one that the map corrects
  kOtherCalibration,  ///< the map corrects a lens, but of no camera with this calibration
};
/// "none", "corrected", "other calibration".
CAIRN_API const char* LensUseName(LensUse use) noexcept;

/// One of several places that an image fits.
struct RivalPose {
  Pose map_from_camera;                  ///< in the frame of `component`, in its units
  std::uint32_t component = 0;           ///< places in different components mean nothing to each other
  Pose world_from_camera;                ///< the same as map_from_camera while the component is not aligned
  double world_per_map = 1.0;            ///< metres per unit of the map, once aligned
  bool world_is_metric = false;          ///< the component has been aligned
  PoseCovariance covariance{};           ///< of map_from_camera
  std::uint32_t reference_keyframe = 0;  ///< the one that shares most points
  int inliers = 0;                       ///< points of the map that are seen where the pose puts them
  double focal_factor = 1.0;             ///< as LocalizeAnswer::focal_factor
};

/// Where a single image was taken; or, if `localized` is false, why that is not known.
struct LocalizeAnswer {
  bool localized = false;                          ///< the pose is valid
  LocalizeStage stage = LocalizeStage::kFeatures;  ///< reached; kDone if localized
  std::string reason;                              ///< of a miss, for people
  LocalizeCounts counts;                           ///< for both
  /// If `stage` is kRivals: the places that fit about as well, at least two, most inliers first. Which one it is a
  /// prior can tell, or a camera that moves on.
  std::vector<RivalPose> rivals;

  Pose map_from_camera;          ///< in the frame of `component`, in its units
  std::uint32_t component = 0;   ///< places in different components mean nothing to each other; 0: none
  int components = 0;            ///< that the map has
  Pose world_from_camera;        ///< the same as map_from_camera while the component is not aligned
  double world_per_map = 1.0;    ///< metres per unit of the map, once aligned
  bool world_is_metric = false;  ///< the component has been aligned
  PoseCovariance covariance{};   ///< of map_from_camera
  /// Where the matches contradict the camera that was given: what its focal length should be multiplied by. The
  /// covariance then has in it by how much the pose would move. 1: they do not.
  double focal_factor = 1.0;

  std::string map_id;                    ///< 32 hex digits
  std::uint64_t revision = 0;            ///< of the map that was asked
  LensUse lens = LensUse::kNone;         ///< what the map knows of this camera
  std::uint32_t reference_keyframe = 0;  ///< the one that shares most points; 0: none
  double extract_ms = 0.0;               ///< time for the features of the image
  double locate_ms = 0.0;                ///< and for the rest
};

/// How a tracker knows where it is.
enum class TrackState {
  kLocated,  ///< found in the map, not by following the image before
  kTracked,  ///< followed, and matched against the map
  kCarried,  ///< followed from where the map was last matched: the covariance grows until it is again
  kLost,     ///< not at all: there is no pose
};
/// "located", "tracked", "carried", "lost".
CAIRN_API const char* TrackStateName(TrackState state) noexcept;

/// Where one image of a stream was taken.
struct TrackAnswer {
  std::int64_t time_ns = 0;              ///< of the image
  TrackState state = TrackState::kLost;  ///< there is a pose unless this is kLost
  std::string reason;                    ///< of kLost and kCarried, for people

  Pose map_from_camera;          ///< in the frame of `component`, in its units
  std::uint32_t component = 0;   ///< places in different components mean nothing to each other; 0: none
  Pose world_from_camera;        ///< the same as map_from_camera while the component is not aligned
  double world_per_map = 1.0;    ///< metres per unit of the map, once aligned
  bool world_is_metric = false;  ///< the component has been aligned
  PoseCovariance covariance{};   ///< of map_from_camera

  std::string map_id;           ///< 32 hex digits
  std::uint64_t revision = 0;   ///< of the map that the pose is from
  std::int64_t matched_ns = 0;  ///< time of the last image that was matched against the map; 0: none yet
  int inliers = 0;              ///< points of the map that were matched in it
  std::string note;       ///< what keeps the tracker from following the map (removed, no server); it goes on without
  double track_ms = 0.0;  ///< time that the call took
  /// To the server of the map; a file is always within reach. Without it what is known of the map goes on to answer.
  bool connected = true;
  double map_age_s = 0.0;  ///< since what is known of the map was the newest for certain; 0 for a file
  /// Where the images until now contradict the camera that was given: what its focal length should be multiplied by.
  /// The covariance covers it. 1: they do not.
  double focal_factor = 1.0;
};

CAIRN_END_NAMESPACE

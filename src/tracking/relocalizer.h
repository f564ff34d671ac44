// "Where is this camera?" without any prior knowledge of the pose, against one revision of a map.
//
// Stages: candidate keyframes by shared words, grouped by covisibility (Mur-Artal, Tardos, "Fast relocalisation and
// loop closing in keyframe-based SLAM", ICRA 2014); 2D-3D matches with all points of a group; PnP in RANSAC; guided
// search over the local map in rounds of shrinking radius, each with motion-only bundle adjustment; acceptance by
// evidence. A miss names the stage that failed.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/status.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"
#include "image/feature.h"
#include "map/snapshot.h"
#include "tracking/group_matcher.h"
#include "tracking/local_map.h"
#include "tracking/place_index.h"
#include "tracking/pnp_ransac.h"
#include "tracking/projection_matcher.h"

namespace cairn::tracking {

struct RelocalizerOptions {
  // Features and candidates.
  int min_features = 30;
  int max_candidate_keyframes = 40;  // that share words, best score first
  int max_groups = 6;                // covisibility groups tried
  int group_size = 8;                // keyframes of a group: the candidate and its best covisible ones
  double min_group_score = 0.5;      // share of the best group's score below which groups are not tried

  // Matches and PnP.
  GroupMatchOptions matching;
  int min_word_matches = 15;
  PnpOptions pnp;  // its seed is mixed with the group's number

  // Guided search: one round per factor.
  std::vector<double> guided_radius_factors = {4.0, 2.0, 1.5};
  int guided_max_distance = 75;  // Hamming, bits
  double guided_max_ratio = 0.9;
  double guided_max_viewing_angle_deg = 75.0;
  double guided_distance_slack = 1.5;
  int descriptors_per_point = 5;  // of its observations, compared with each feature near its projection
  LocalMapOptions local_map{.max_keyframes = 20, .neighbours_per_keyframe = 5, .tree_neighbours = true};

  // Acceptance. Inliers alone prove little: an object that has a twin elsewhere, furniture that stands in two rooms,
  // give more than a hundred in a part of the image. They must be nearly everywhere where points should be in view. In
  // five pairs of rendered rooms with furniture of one catalogue images of the wrong room had inliers in 0.32 to 0.5 of
  // the cells with visible points; 99 % of a real kitchen's in 0.45 and more, 83 % in 0.55 and more.
  int min_inliers = 25;
  int min_cells = 8;          // of 8 x 8 in the image that must hold inliers
  double min_support = 0.45;  // of the cells with visible points that must hold inliers
  // Beyond doubt. Below it the other groups are tried, too, and the most inliers win; and a session does not go on
  // there without further proof.
  int strong_inliers = 50;
  double strong_support = 0.55;
  double max_position_sigma = 0.02;  // standard deviation of the position, as share of the median depth of the inliers
  double max_rotation_sigma_deg = 0.6;

  absl::Status Validate() const;
};

enum class RelocalizationStage { kFeatures, kCandidates, kMatches, kPnp, kRefinement, kDone };

// Of the attempt that got furthest.
struct RelocalizationCounts {
  int features = 0;
  int candidates = 0;  // keyframes that share enough words
  int word_matches = 0;
  int pnp_inliers = 0;
  int guided_matches = 0;  // in the last round
  int inliers = 0;         // after refinement
  int visible = 0;         // points of the local map that should be in view
  int cells = 0;           // of 8 x 8 in the image that hold inliers
  int visible_cells = 0;   // likewise, visible points
};

struct PointObservation {
  PointId point;
  std::uint32_t feature = 0;
};

struct Relocalization {
  bool localized = false;
  bool beyond_doubt = false;                                   // RelocalizerOptions::strong_support
  RelocalizationStage stage = RelocalizationStage::kFeatures;  // that failed, or kDone
  std::string reason;                                          // of a miss, for people
  RelocalizationCounts counts;

  SE3 camera_from_map;
  // Of (translation, rotation) as a left increment of map_from_camera, map units and radians.
  Matrix6d covariance = Matrix6d::Zero();
  KeyframeId reference_keyframe;          // that sees most of the inliers
  std::vector<PointObservation> inliers;  // ascending by point
};

// Which components of the map count.
struct SearchArea {
  ComponentId only;    // none: all ...
  ComponentId except;  // ... but this

  bool Contains(ComponentId component) const {
    return (!only || component == only) && (!except || component != except);
  }
};

class Relocalizer {
 public:
  explicit Relocalizer(const RelocalizerOptions& options = {}) : options_(options) {}

  const RelocalizerOptions& options() const { return options_; }

  // A miss is an answer. The same input gives the same answer; may be called by several threads at once.
  // InvalidArgument: bad options or camera. FailedPrecondition: `places` is of another revision than `map`.
  absl::StatusOr<Relocalization> Relocalize(const map::Snapshot& map, const PlaceIndex& places, const Pinhole& pinhole,
                                            const image::Features& features, const SearchArea& area = {}) const;

 private:
  RelocalizerOptions options_;
};

}  // namespace cairn::tracking

// What a map says about one image of a stream: matched against the part of the map around where the camera is thought
// to be, or found anywhere. Features (ORB) are those that the map's keyframes were made with.
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/ids.h"
#include "base/status.h"
#include "direct/packet.h"
#include "geometry/se3.h"
#include "image/feature.h"
#include "image/undistort.h"
#include "optimization/focal_estimate.h"
#include "tracking/local_map_tracker.h"
#include "tracking/map_error.h"
#include "tracking/map_view.h"
#include "tracking/relocalizer.h"

namespace cairn::client {

struct MapMatcherOptions {
  tracking::RelocalizerOptions relocalizer;
  tracking::LocalMapTrackerOptions local_map{.weigh_points = true};
  int num_features = 0;             // per image; 0: as many as the map's keyframes were made with
  int num_features_followed = 800;  // per image while every one is followed by features: fewer are enough
  // Of the matches of the last round of LocalMapTracker, the share that must agree on one pose. In a place that only is
  // thought to be the right one, what lies within the search radius agrees on nothing.
  double min_inlier_share = 0.4;
  // The share of the view that must show what it should (tracking/view_support.h). Where the camera has jumped, matches
  // near by agree on the wrong pose: in redkitchen at most 0.45 of the view then, else 0.58 and more in 95 % of the
  // matches.
  double min_support = 0.45;
  // Where the camera was lost, or was not matched lately: as many matches must agree, as of a relocalization whose
  // support is not weighed.
  int min_inliers_after_loss = 50;

  absl::Status Validate() const;
};

// Features of an undistorted image.
struct ImageFeatures {
  image::Features features;               // where the map's camera would have seen them (map/lens.h)
  std::vector<image::Keypoint> in_image;  // where they are in the image
};

// Where the camera is in one component of one revision of a map, and what it sees of it.
struct Place {
  ComponentId component;
  SE3 map_from_camera;
  KeyframeId reference;       // that shares most of the points
  std::vector<PointId> seen;  // points of the map
  double median_depth = 0.0;  // of these, map units
  tracking::MapError bend;    // around the reference (tracking/map_bend.h)

  // The same place in another revision: it moves with the reference keyframe, also where the keyframe's component was
  // joined to another one; nothing if the keyframe has left the map. `scale` gets the length there of the unit here.
  std::optional<Place> In(const map::Snapshot& before, const map::Snapshot& after, double* scale) const;
};

// What is known of an image's place before it is matched.
struct Expectation {
  Place place;
  // Per axis, as tracking::PoseSeed; 0: the pose is only where the search starts.
  double translation_sigma = 0.0;  // map units
  double rotation_sigma_rad = 0.0;
  bool after_loss = false;  // search wide, and be cautious
  bool cautious = false;    // as many matches as after a loss must agree
};

// What is kept of the map from one image of a stream to the next.
struct StreamCache {
  std::shared_ptr<const map::Snapshot> map;  // that the points are of
  tracking::LocalPointCache points;
};

// A match of an image with the map.
struct Sighting {
  bool found = false;
  std::string reason;      // of a miss, for people
  bool misplaced = false;  // of a miss: the map should be seen there, and is not: the camera is elsewhere, or covered
  Place place;
  // Of (translation, rotation) as a left increment of map_from_camera, map units and radians, as the matches leave it:
  // that the map errs there is not in it.
  Matrix6d covariance = Matrix6d::Zero();
  int inliers = 0;
  double residual_rms = 1.0;  // tracking::TrackedView::residual_rms
  // What the matches say of the camera's calibration, if anything; the covariance covers it.
  std::optional<optimization::FocalEstimate> calibration;
  // The points seen, where they are in the image, with 1 / depth in map units: a direct::KnownView.
  std::vector<direct::PacketPoint> depths;
};

// Safe from several threads at once.
class MapMatcher {
 public:
  MapMatcher(const MapMatcherOptions& options, std::shared_ptr<const image::Undistorter> undistorter)
      : options_(options), relocalizer_(options.relocalizer), undistorter_(std::move(undistorter)) {}

  // All of them, or as many as are enough to follow a camera.
  absl::StatusOr<ImageFeatures> Extract(const tracking::MapView& view, const cv::Mat& undistorted, bool all) const;
  // `cache`: of the stream that the image belongs to, for one thread at a time; may be null.
  Sighting Match(const tracking::MapView& view, const ImageFeatures& image, const Expectation& expected,
                 StreamCache* cache = nullptr) const;
  // Anywhere, accepted as tracking::Relocalizer does.
  absl::StatusOr<Sighting> Find(const tracking::MapView& view, const ImageFeatures& image) const;

 private:
  double SupportOf(const map::Snapshot& map, const ImageFeatures& image, const tracking::TrackedView& tracked) const;
  std::optional<optimization::FocalEstimate> CalibrationBy(const map::Snapshot& map, const ImageFeatures& image,
                                                           const tracking::TrackedView& tracked) const;
  Sighting ToSighting(const tracking::MapView& view, const ImageFeatures& image,
                      const tracking::TrackedView& tracked) const;

  const MapMatcherOptions options_;
  const tracking::Relocalizer relocalizer_;
  const std::shared_ptr<const image::Undistorter> undistorter_;
};

}  // namespace cairn::client

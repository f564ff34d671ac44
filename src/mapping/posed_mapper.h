// A map from still images whose poses are known (`cairn run --poses FILE`): no odometry, views may be seconds apart.
// Features are matched between views that overlap, gated by the epipolar lines of the known poses; matches become
// tracks, tracks become points; bundle adjustment refines the points and, within a prior, the poses.
//
// The world is the frame of the given poses: in an empty map they make a component whose world_from_component is the
// identity; otherwise they are moved into the aligned component by the inverse of its own.
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>

#include "base/status.h"
#include "base/time.h"
#include "map/edit.h"
#include "mapping/map_head.h"
#include "mapping/pose_check.h"

namespace cairn::mapping {

struct PosedMapperOptions {
  int features_per_image = 2000;
  int pairs_per_image = 12;          // views matched with each view: the nearest by view, and by words
  double max_view_angle_deg = 60.0;  // between the optical axes of a pair
  double max_baseline_share = 1.0;   // of the scene depth (estimated while mapping)
  double max_epipolar_px = 3.0;      // at octave 0; allows for errors of the given poses
  double max_reprojection_px = 3.0;  // likewise, of a triangulated point before adjustment
  double min_parallax_deg = 1.0;
  // Standard deviations of the given poses; 0: the poses are exact and stay as they are.
  double position_sigma_share = 0.001;  // of the median scene depth
  double rotation_sigma_deg = 0.05;
  int adjustment_iterations = 15;
  // Poses that explain fewer of the matches (mapping/pose_check.h) are not those of the images, nor are poses of which
  // the inverses explain clearly more. Right ones explain 0.8 to 1, others 0 to 0.2 (0.5 if the camera hardly turns).
  double min_fit_share = 0.4;

  absl::Status Validate() const;
};

struct PosedImage {
  std::int64_t index = 0;  // in the sequence
  TimeNs time_ns = 0;
  cv::Mat image;  // CV_8UC1, undistorted, of the size of the camera's pinhole
  SE3 world_from_camera;
};

struct PosedMapperReport {
  PoseCheck fit;         // of the given poses
  int found_in_map = 0;  // of the views looked for in the map that was there before, to check their poses
  int keyframes = 0;
  int keyframes_without_points = 0;  // left out of the map: nothing in them could be triangulated
  int points = 0;
  int observations = 0;
  double rmse_px = 0.0;             // of the reprojection errors, at octave 0
  double median_pose_change = 0.0;  // of the camera centres by the adjustment, in units of the given poses
};

class PosedMapper {
 public:
  // As FeatureMapper::Create. FailedPrecondition if the map has keyframes but no aligned component.
  static absl::StatusOr<std::unique_ptr<PosedMapper>> Create(const PosedMapperOptions& options, MapHead* head,
                                                             SessionId session, CameraId camera);
  ~PosedMapper();
  PosedMapper(const PosedMapper&) = delete;
  PosedMapper& operator=(const PosedMapper&) = delete;

  // Extracts the features of one view. InvalidArgument for an image that does not fit the camera or a pose that is not
  // finite. Returns the number of features.
  absl::StatusOr<int> Add(const PosedImage& image);

  // While the head is the caller's: matches, triangulates, adjusts and commits: the map is complete after it.
  // FailedPrecondition if fewer than two views share points, or the poses do not fit the images, or not what the map
  // shows of the same place. Nothing may be added afterwards.
  absl::StatusOr<PosedMapperReport> Finish();

 private:
  class Impl;
  explicit PosedMapper(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace cairn::mapping

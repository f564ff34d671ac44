// The start of the odometry: corners are followed by pyramidal Lucas-Kanade from a reference frame until two-view
// geometry and a bundle adjustment over the frames between agree on a motion with enough parallax. A photometric start,
// as in DSO Sec. 3.1, converges to wrong depths when the motion is small and mostly a rotation; this one waits instead.
//
// Degenerate motion (still camera, pure rotation) shows as lack of parallax after the best rotation is taken out. A
// scene that one homography explains has two essential matrices, and a small motion leaves other minima still (a turn
// passes for a shift, near for far: Chiuso, Brockett and Soatto, "Optimal Structure from Motion: Local Ambiguities and
// Global Estimates", IJCV 2000). The homography's decompositions and motions to all sides are tried, and the start
// waits until the views tell them apart. Where nothing fits any more the reference moves on.
#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "direct/odometry_options.h"
#include "direct/packet.h"
#include "direct/structure_adjustment.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"

namespace cairn::direct {

struct StartResult {
  bool success = false;
  bool new_reference = false;  // corners were lost: this frame is the new reference
  bool misfit = false;         // no motion fits the corners well enough
  std::string message;         // what it waits for
  // On success: one pose per frame added since and with the reference (identity first); the median inverse depth is 1.
  std::vector<SE3> camera_from_reference;
  std::vector<Vector2d> reference_px;  // of the corners used, full resolution
  std::vector<double> inverse_depth;
  double parallax_rad = 0.0;
  double rms_px = 0.0;
  double cost = 1e300;          // mean squared error in px^2, of corners that do not fit their limit; compares motions
  double misfit_share = 1e300;  // `rms_px` as an angle, over the parallax
};

class FeatureStart {
 public:
  FeatureStart(const OdometryOptions& options, const Pinhole& camera);

  // Forgets everything: the next frame becomes the reference.
  void Reset();
  StartResult Add(const Frame& frame);
  // After a success: follows the corners on without a new answer. False once fewer than half of them are left.
  bool Continue(const Frame& frame);
  // A new answer from all frames since the reference.
  StartResult SolveAgain();
  // How well poses of all frames since the reference (identity first) explain the corners, as StartResult::cost; large
  // if too few corners are left to tell. Frames that are not known are left out.
  double CostOf(const std::vector<std::optional<SE3>>& camera_from_reference) const;
  // Of those corners alone that the poses explain within 2 px or so; 0 if too few corners are left to tell.
  double InlierRmsPxOf(const std::vector<std::optional<SE3>>& camera_from_reference) const;
  // Frames since and with the reference.
  int FrameCount() const { return static_cast<int>(tracks_.size()); }

 private:
  void SetReference(const cv::Mat& gray);
  bool Follow(const cv::Mat& gray);
  std::optional<StructureReport> Explain(const std::vector<std::optional<SE3>>& camera_from_reference) const;
  StartResult Solve();
  StartResult Choose(const std::vector<SE3>& candidates, const std::vector<int>& alive, const std::vector<int>& views,
                     bool plane, double flow_rad);
  bool RefinePair(const std::vector<int>& alive, SE3* pose, double* cost);
  StartResult Reconstruct(const SE3& pose, const std::vector<int>& alive, const std::vector<int>& views);

  OdometryOptions options_;
  Pinhole camera_;
  std::vector<cv::Mat> reference_pyramid_;
  std::vector<cv::Mat> last_pyramid_;
  std::vector<bool> alive_;
  std::vector<std::vector<cv::Point2f>> tracks_;  // [frame since reference][corner]
  int first_count_ = 0;
  double last_attempt_parallax_rad_ = 0.0;
  int solved_count_ = 0;  // corners left when the start succeeded
  int misfits_ = 0;       // attempts with this reference
};

}  // namespace cairn::direct

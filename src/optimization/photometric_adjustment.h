// Response, vignette and exposures of a camera from intensities of the same surface points in many frames, after
// Bergmann, Wang, Cremers, "Online Photometric Calibration of Auto Exposure Video for Realtime Visual Odometry and
// SLAM" (RA-L 2018), Eq. 1 and 5: a point p of radiance L_p seen in frame j, at radius rho from the image's centre, is
//   I = 255 W(z),  z = (e_j V(rho) L_p)^kappa,  V(rho) = 1 + v1 rho^2 + v2 rho^4 + v3 rho^6,
// with rho 1 at the farthest corner of the image. All unknowns are found together: Levenberg-Marquardt on the residuals
// in gray levels, Huber's loss, the radiances eliminated by the Schur complement.
//
// What no sequence can tell without exposure times: (e, V, L) and (e^g, V^g, L^g) with another response give the same
// intensities. With exposure times kappa is an unknown. Without, it is 1 and a weak prior on c chooses the response
// that is nearest to linear; any choice makes the brightness of a point constant, which is what an odometry needs.
#pragma once

#include <vector>

#include "base/status.h"
#include "optimization/photometric_model.h"

namespace cairn::optimization {

struct PhotometricObservation {
  int point = 0;
  int frame = 0;
  double radius = 0.0;      // in [0, 1]
  double intensity = 0.0;   // in [0, 255], raw
  double sigma_gray = 1.0;  // standard deviation
};

struct PhotometricAdjustmentOptions {
  double huber = 1.5;           // of a whitened residual
  double response_sigma = 1.0;  // prior of each c against 0
  double vignette_sigma = 2.0;  // prior of each v against 0
  double exposure_sigma = 1.0;  // prior of unknown log exposures against their mean
  int max_iterations = 100;
  double min_intensity = 4.0;  // darker or brighter observations are not used: black level and saturation
  double max_intensity = 250.0;
  int min_point_frames = 4;  // a point seen less often is not used

  absl::Status Validate() const;
};

struct PhotometricAdjustmentResult {
  PhotometricModel model;
  // Per frame. If unknown the mean is 0, and NaN stands for a frame without observations.
  std::vector<double> log_exposure;
  int iterations = 0;
  int points = 0;
  int observations = 0;
  double rms_gray = 0.0;  // of the inliers
  double inlier_share = 0.0;
  // Standard deviations that the observations leave, as a share of full scale: of the intensity that the model gives
  // for a known irradiance, root mean square over all, and of the vignette at radius 1; without exposure times, given
  // the choice of the power.
  double response_sigma = 0.0;
  double vignette_sigma = 0.0;
};

// `exposure_s`: one per frame, all positive: known; all zero: to be estimated. InvalidArgument for bad input;
// FailedPrecondition, saying what lacks, if there is too little to work with.
absl::StatusOr<PhotometricAdjustmentResult> AdjustPhotometry(const std::vector<PhotometricObservation>& observations,
                                                             const std::vector<double>& exposure_s,
                                                             const PhotometricAdjustmentOptions& options = {});

}  // namespace cairn::optimization

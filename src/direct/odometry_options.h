// The settings of the photometric odometry, with defaults for every sequence. Parameter names follow Engel, Koltun and
// Cremers, "Direct Sparse Odometry" (PAMI 2018), Sec. 2 to 4, called DSO below.
#pragma once

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace cairn::direct {

struct OdometryOptions {
  // Images.
  bool full_resolution = false;  // false: work on 2x2 means of the input
  int max_pyramid_levels = 6;    // fewer for small images: the coarsest level keeps at least min_level_pixels
  int min_level_pixels = 400;

  // Window.
  int max_keyframes = 7;        // in the optimization window
  int min_keyframes = 3;        // never fewer, whatever they still see
  int max_active_points = 800;  // in the window
  int candidates_per_keyframe = 800;
  int max_iterations = 4;  // Gauss-Newton steps per keyframe

  // Photometric model, in gray levels of [0, 255].
  double huber_gray = 9.0;
  double gradient_constant_gray = 50.0;  // c of the gradient weight c^2 / (c^2 + |grad|^2)
  double outlier_gray = 12.0;            // a residual is an outlier beyond this root mean square over its pattern ...
  double outlier_median_factor = 2.5;    // ... or beyond this many medians of its frame, whichever is larger
  // Priors of the brightness transfer against 0 where calibration and exposure are known (light.h, DSO Sec. 2.2), as
  // standard deviations beside a single residual's one gray level, so that the calibration counts more than a window of
  // residuals; 0: no prior. Elsewhere gain and offset are free.
  double affine_a_sigma = 1e-4;       // of the log gain a
  double affine_b_sigma_gray = 1e-3;  // of the offset b

  // Pixel selection (region-adaptive threshold: median gradient of 32 x 32 blocks plus an offset).
  double gradient_offset_gray = 7.0;

  // Tracing and activation.
  double max_search_share = 0.027;        // of width + height: longest epipolar search
  double trace_slack_px = 1.5;            // an interval shorter than this is not searched any more
  double min_trace_quality = 3.0;         // second-best over best energy
  double min_activation_hessian = 100.0;  // information of the inverse depth needed to activate a point
  double min_marginalization_hessian = 50.0;

  // Keyframe decision (DSO Sec. 3.1: weighted optical flow with and without rotation, brightness change).
  double keyframe_weight = 0.3;             // scales the flow terms: larger makes more keyframes
  double keyframe_flow_weight = 0.04;       // per pixel of (640 + 480)-normalized translational flow
  double keyframe_full_flow_weight = 0.02;  // the same of the full flow
  double keyframe_affine_weight = 2.0;      // per unit of |log gain|
  double keyframe_residual_ratio = 2.0;     // of the root mean square residual against the keyframe's first
  double keyframe_min_tracked_share = 0.7;  // of the reference's points in view: fewer, and new points are needed
  double min_visible_share = 0.05;          // marginalize a keyframe with fewer of its points visible in the newest
  double max_affine_change = 0.7;           // marginalize a keyframe with |log gain| to the newest beyond

  // Tracking.
  double coarse_cutoff_gray = 20.0;
  double min_tracked_share = 0.25;   // of reference points inside the image and below the cutoff
  double motion_sigma_factor = 3.0;  // times the errors of the last predictions: the prior of a frame's motion
  int max_lost_frames = 30;          // after as many frames a new segment starts

  // Start.
  int start_features = 500;
  double start_min_parallax_deg = 1.0;     // median angle between the rays of matched corners, rotation removed
  double start_max_reprojection_px = 1.0;  // root mean square after bundle adjustment, at full resolution
  double start_min_inlier_share = 0.75;
  int start_min_features = 60;
  // Images kept to be tracked once the start succeeds, beside those since the start's reference (up to 90). A longer
  // wait keeps ever fewer of them, evenly spread; the frames between get poses between.
  int max_retained_frames = 50;

  // False, for an odometry that runs for days and of which only live poses are wanted: the poses of old frames and
  // keyframes are forgotten, and Poses(), FrameResults() and KeyframeTrajectory() are empty.
  bool keep_history = true;

  absl::Status Validate() const;
};

// Settings for a purpose; what each costs and gives is in docs/benchmarks.md.
enum class Preset {
  kFast,      // as DSO's reduced setting: a smaller window, fewer points
  kDefault,   // OdometryOptions as they are
  kAccurate,  // for recordings: more points and iterations
};
OdometryOptions PresetOptions(Preset preset);
// "fast", "default" or "accurate".
absl::StatusOr<Preset> PresetFromName(absl::string_view name);

}  // namespace cairn::direct

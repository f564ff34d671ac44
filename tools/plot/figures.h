// Pictures of results: a trajectory against its ground truth, errors over time, and a map from above. The file's ending
// says whether PNG or SVG is written. All positions are in metres in one world frame.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/status.h"
#include "base/time.h"
#include "geometry/se3.h"

namespace cairn::plot {

struct FigureOptions {
  double width_pt = 760.0;
  double pixel_scale = 2.0;  // pixels per point in a PNG
  bool overwrite = false;    // AlreadyExists otherwise

  absl::Status Validate() const;
};

enum class View {
  kAuto,       // top, and side if the third extent is more than a twentieth of the first
  kTop,        // the plane of largest extent
  kTopAndSide  // and, below it, seen from the side
};

struct PlottedPose {
  TimeNs time_ns = 0;
  Vector3d position_m = Vector3d::Zero();
  double error_m = 0.0;
};

struct TrajectoryFigure {
  std::string title = {};
  std::string estimate_label = "estimate";
  std::string groundtruth_label = "ground truth";
  std::vector<PlottedPose> estimate = {};                     // aligned, in the order of time
  std::vector<std::pair<TimeNs, Vector3d>> groundtruth = {};  // in the order of time
  View view = View::kAuto;
};

// The estimate is coloured by its error, lines to the true positions are drawn where the error is visible, and the
// title gains the RMSE. If the plane of largest extent is close to two of the world's axes these are the axes of the
// picture, else the principal axes about the centre. Lines break where a trajectory has a gap in time.
absl::Status WriteTrajectoryFigure(const TrajectoryFigure& figure, const std::string& path,
                                   const FigureOptions& options = {});

struct ErrorSeries {
  std::string label = {};
  std::vector<double> time_s;
  std::vector<double> value;  // as many; NaN makes a gap
};

struct ErrorFigure {
  std::string title = {};
  std::string value_label = "position error [m]";
  std::vector<ErrorSeries> series = {};
  bool log_scale = false;  // of the values; those that are not positive are left out
};

absl::Status WriteErrorFigure(const ErrorFigure& figure, const std::string& path, const FigureOptions& options = {});

struct PhotometricFigure {
  std::string title = {};
  std::array<double, 256> inverse_response = {};  // in [0, 255]
  std::vector<double> vignette = {};              // at radii from 0 to 1, evenly spaced
  std::vector<int> intensity_seen = {};           // how often each gray value was; empty: not drawn
};

// Beside each other: light over gray value with the histogram of what was seen, and the vignette over the radius.
absl::Status WritePhotometricFigure(const PhotometricFigure& figure, const std::string& path,
                                    const FigureOptions& options = {});

struct PlottedKeyframe {
  SE3 world_from_camera;
  int group = 0;  // of colour: the session
};

struct MapFigure {
  std::string title = {};
  std::vector<Vector3d> points_m = {};
  std::vector<PlottedKeyframe> keyframes = {};                      // in the order of time
  std::vector<std::pair<std::size_t, std::size_t>> covisible = {};  // indices into keyframes
  std::vector<std::string> group_labels = {};                       // "session 1", ...; empty: "keyframes"
  std::vector<SE3> queries = {};                                    // relocalized cameras, drawn on top
  // The direction against gravity. Nothing: that in which the cameras' images are upright on average.
  std::optional<Vector3d> up = std::nullopt;
  bool metric = true;  // axes in metres; else in map units
};

// Seen from above. Points far outside (beyond the middle 96 %, and far from every keyframe) do not stretch the picture.
absl::Status WriteMapFigure(const MapFigure& figure, const std::string& path, const FigureOptions& options = {});

}  // namespace cairn::plot

// Pictures of what is in a map: what a keyframe sees, and distributions.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "base/status.h"
#include "plot/figures.h"

namespace cairn::plot {

struct ViewMark {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double radius_px = 3.0;  // of the patch that the feature was found in
  bool has_point = false;
  Eigen::Vector2d error_px = Eigen::Vector2d::Zero();  // of one with a point: keypoint minus projection
};

// An image plane: features as gray rings, those with a point coloured by the length of their reprojection error, which
// is drawn as a line `kErrorScale` times as long.
struct ViewFigure {
  std::string title = {};
  std::string subtitle = {};
  int width_px = 0;
  int height_px = 0;
  std::vector<ViewMark> marks = {};
};
inline constexpr double kErrorScale = 5.0;
absl::Status WriteViewFigure(const ViewFigure& figure, const std::string& path, const FigureOptions& options = {});

struct HistogramPanel {
  std::string title = {};
  std::string label = {};  // of the values
  double low = 0.0;
  double step = 1.0;
  std::vector<std::int64_t> bins = {};
  double marked = 0.0;  // the median: a line
};

struct HistogramFigure {
  std::string title = {};
  std::vector<HistogramPanel> panels = {};
};
absl::Status WriteHistogramFigure(const HistogramFigure& figure, const std::string& path,
                                  const FigureOptions& options = {});

struct MatchedView {
  std::string label = {};
  int width_px = 0;
  int height_px = 0;
  cv::Mat image = {};  // CV_8UC1; empty: not known
  std::vector<Eigen::Vector2d> features = {};
};

struct PlottedMatch {
  Eigen::Vector2d left = Eigen::Vector2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  bool inlier = false;
};

// Two images side by side, with lines between what is matched; one alone, with its features, if the right one has no
// size.
struct MatchFigure {
  std::string title = {};
  std::string subtitle = {};
  MatchedView left = {};
  MatchedView right = {};
  std::vector<PlottedMatch> matches = {};
};
absl::Status WriteMatchFigure(const MatchFigure& figure, const std::string& path, const FigureOptions& options = {});

struct HeatCell {
  double x = 0.0, y = 0.0;  // lower left corner
  double share = 0.0;       // in [0, 1]
  std::string label = {};
};

struct HeatMark {
  Eigen::Vector2d at = Eigen::Vector2d::Zero();
  Eigen::Vector2d direction = Eigen::Vector2d::Zero();  // looked along; of length up to 1
  bool good = true;
};

// The ground from above: cells coloured by a share, cameras as arrows, those that are not good in vermilion, points of
// the map behind.
struct HeatFigure {
  std::string title = {};
  std::string subtitle = {};
  std::string axis_unit = {};  // "m"
  std::string axes[2] = {"along the largest extent", "across"};
  double cell_size = 1.0;
  std::vector<HeatCell> cells = {};
  std::vector<HeatMark> marks = {};
  std::vector<Eigen::Vector2d> points = {};
};
absl::Status WriteHeatFigure(const HeatFigure& figure, const std::string& path, const FigureOptions& options = {});

}  // namespace cairn::plot

// A map as a scene: points, cameras and lines in colours of the caller's, seen from above, from the side, or in
// perspective.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "base/status.h"
#include "geometry/se3.h"
#include "plot/axes.h"
#include "plot/canvas.h"
#include "plot/figures.h"

namespace cairn::plot {

enum class SceneView { kPlan, kSide, kPerspective };

struct ScenePoint {
  Vector3d at = Vector3d::Zero();
  Color color = kGray;
};

struct SceneCamera {
  SE3 scene_from_camera;
  Color color = kInk;
};

struct SceneLine {
  Vector3d from = Vector3d::Zero();
  Vector3d to = Vector3d::Zero();
  Color color = kGray;
  double width_pt = 1.0;
};

// What Sequential() colours mean: 0 and 1 of it.
struct SceneScale {
  std::string label = {}, low = {}, high = {};
};

struct SceneFigure {
  std::string title = {};
  std::string subtitle = {};
  std::string unit = {};  // "m"
  SceneView view = SceneView::kPlan;
  std::vector<ScenePoint> points = {};
  std::vector<SceneLine> lines = {};
  std::vector<SceneCamera> cameras = {};  // drawn on top, in this order
  std::vector<LegendEntry> legend = {};
  std::optional<SceneScale> scale = std::nullopt;
  Vector3d up = Vector3d::UnitZ();  // against gravity
};

// Points far outside (beyond the middle 96 %) do not stretch the picture. Cameras are drawn smaller the more there are.
// InvalidArgument if there is nothing to draw or a position is not finite.
absl::Status WriteSceneFigure(const SceneFigure& figure, const std::string& path, const FigureOptions& options = {});

}  // namespace cairn::plot

#include "plot/scene_figure.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "plot/projection.h"

namespace cairn::plot {
namespace {

constexpr double kSceneLeft = 66.0, kSceneRight = 24.0, kSceneTop = 62.0, kSceneBottom = 44.0, kScaleHeight = 26.0,
                 kLegendRow = 18.0;
constexpr double kElevationDeg = 32.0, kTurnDeg = 35.0;  // of the perspective, from the side and above
constexpr double kEyeDistance = 2.2;                     // of it from the middle, extents of the scene

// From the scene to the plane of the picture, right and up; the third is towards the viewer.
class Eye {
 public:
  Eye(const SceneFigure& figure, const std::vector<Vector3d>& around, const Vector3d& middle, double extent)
      : projection_(TopView(around, figure.up)), names_{projection_.names[0], projection_.names[1]} {
    if (figure.view == SceneView::kPlan) return;
    const Matrix3d top = projection_.axes;
    Matrix3d side;
    side << top.row(0), top.row(2), -top.row(1);
    names_[1] = projection_.names[2];
    projection_.axes = side;
    if (figure.view == SceneView::kSide) return;
    const double turn = kTurnDeg * std::numbers::pi / 180.0, rise = kElevationDeg * std::numbers::pi / 180.0;
    projection_.axes = Eigen::AngleAxisd(rise, Vector3d::UnitX()).toRotationMatrix() *
                       Eigen::AngleAxisd(turn, Vector3d::UnitY()).toRotationMatrix() * side;
    projection_.origin = middle;
    distance_ = kEyeDistance * extent;
  }

  // None behind the eye.
  std::optional<Vector3d> operator()(const Vector3d& point) const {
    Vector3d seen = projection_(point);
    if (distance_ == 0.0) return seen;
    const double away = distance_ - seen.z();
    if (away < 0.05 * distance_) return std::nullopt;
    seen.head<2>() *= distance_ / away;
    return seen;
  }
  bool perspective() const { return distance_ > 0.0; }
  const std::string& name(int axis) const { return names_[axis]; }

 private:
  Projection projection_;
  std::string names_[2];
  double distance_ = 0.0;  // 0: infinitely far away
};

// The positions that decide what is in the picture.
std::vector<Vector3d> Framed(const SceneFigure& figure) {
  std::vector<double> values[3];
  for (const ScenePoint& point : figure.points) {
    for (int i = 0; i < 3; ++i) values[i].push_back(point.at[i]);
  }
  Range range[3];
  for (int i = 0; i < 3; ++i) range[i] = MiddleOf(values[i]);
  std::vector<Vector3d> framed;
  for (const ScenePoint& point : figure.points) {
    bool inside = true;
    for (int i = 0; i < 3; ++i) inside &= point.at[i] >= range[i].low && point.at[i] <= range[i].high;
    if (inside) framed.push_back(point.at);
  }
  for (const SceneCamera& camera : figure.cameras) framed.push_back(camera.scene_from_camera.translation());
  return framed;
}

absl::Status CheckScene(const SceneFigure& figure) {
  if (figure.points.empty() && figure.cameras.empty()) {
    return absl::InvalidArgumentError("scene figure: there are neither points nor cameras to draw");
  }
  bool finite = true;
  for (const ScenePoint& point : figure.points) finite &= point.at.allFinite();
  for (const SceneCamera& camera : figure.cameras) finite &= camera.scene_from_camera.translation().allFinite();
  for (const SceneLine& line : figure.lines) finite &= line.from.allFinite() && line.to.allFinite();
  if (!finite) return absl::InvalidArgumentError("scene figure: a position is not finite");
  if (!(figure.up.norm() > 1e-9)) return absl::InvalidArgumentError("scene figure: up must be a direction");
  return absl::OkStatus();
}

// Rows of entries, as many as fit on each; returns how many rows there are. Null: only counts.
int LayLegend(Canvas& canvas, const Rect& area, const std::vector<LegendEntry>& entries, bool draw) {
  const TextStyle style{.size_pt = 10.5};
  const double room = area.width;
  double x = 0.0;
  int row = 0;
  for (const LegendEntry& entry : entries) {
    const double width = std::min(room, 44.0 + canvas.TextWidth(entry.label, style));
    if (x > 0.0 && x + width > room) {
      x = 0.0;
      ++row;
    }
    if (draw) {
      const double y = area.y + kLegendRow * row;
      DrawLegend(canvas, {area.x + x + width - 18.0, y}, {entry});
    }
    x += width;
  }
  return entries.empty() ? 0 : row + 1;
}

// A grid on the ground, for the eye to hold on to.
void DrawGround(Canvas& canvas, const Axes& axes, const Eye& eye, const SceneFigure& figure,
                const std::vector<Vector3d>& framed) {
  const Projection top = TopView(framed, figure.up);
  Range x, y, z;
  for (const Vector3d& p : framed) {
    const Vector3d q = top(p);
    x.Include(q.x());
    y.Include(q.y());
    z.Include(q.z());
  }
  const std::vector<double> ticks = Ticks(x, 6);
  const double step = ticks.size() > 1 ? ticks[1] - ticks[0] : std::max(x.size(), 1e-3);
  const auto line = [&](double x0, double y0, double x1, double y1) {
    const auto place = [&](double u, double v) {
      return eye(top.axes.transpose() * Vector3d(u, v, z.low) + top.origin);
    };
    const auto from = place(x0, y0), to = place(x1, y1);
    if (!from || !to) return;
    canvas.Line(axes.ToPage(from->x(), from->y()), axes.ToPage(to->x(), to->y()), Color{0.80, 0.80, 0.84}, 0.7);
  };
  const double x0 = std::floor(x.low / step) * step, x1 = std::ceil(x.high / step) * step;
  const double y0 = std::floor(y.low / step) * step, y1 = std::ceil(y.high / step) * step;
  for (double u = x0; u <= x1 + 0.5 * step; u += step) line(u, y0, u, y1);
  for (double v = y0; v <= y1 + 0.5 * step; v += step) line(x0, v, x1, v);
  canvas.Text({axes.area().right() - 8.0, axes.area().bottom() - 8.0},
              absl::StrCat("grid: ", TickLabel(step, step), " ", figure.unit),
              {.size_pt = 10.0, .color = kGray, .align = Align::kRight});
}

// How long cameras are drawn: those that stand beside each other must stay apart.
double CameraSize(const std::vector<Point>& at) {
  if (at.size() < 2) return 11.0;
  std::vector<double> gaps;
  for (std::size_t i = 1; i < at.size(); ++i) gaps.push_back(std::hypot(at[i].x - at[i - 1].x, at[i].y - at[i - 1].y));
  const auto middle = gaps.begin() + static_cast<std::ptrdiff_t>(gaps.size() / 2);
  std::nth_element(gaps.begin(), middle, gaps.end());
  return std::clamp(1.1 * *middle, 4.5, 11.0);
}

void DrawCamera(Canvas& canvas, const Axes& axes, const Eye& eye, const SceneCamera& camera, double length) {
  const auto to_page = [&](const Vector3d& corner) -> std::optional<Point> {
    const auto seen = eye(camera.scene_from_camera * Vector3d(length * corner));
    if (!seen) return std::nullopt;
    return axes.ToPage(seen->x(), seen->y());
  };
  const auto apex = to_page(Vector3d::Zero());
  std::vector<Point> base;
  for (const Vector3d& corner :
       {Vector3d(-0.6, -0.45, 1), Vector3d(0.6, -0.45, 1), Vector3d(0.6, 0.45, 1), Vector3d(-0.6, 0.45, 1)}) {
    if (const auto point = to_page(corner)) base.push_back(*point);
  }
  if (!apex || base.size() != 4) return;
  const double width = length * axes.points_per_unit() < 7.0 ? 0.6 : 0.9;
  canvas.Polygon(base, camera.color.WithAlpha(0.22), camera.color, width);
  for (const Point& corner : base) canvas.Line(*apex, corner, camera.color, width);
}

void DrawScene(Canvas& canvas, const Axes& axes, const Eye& eye, const SceneFigure& figure) {
  struct Dot {
    double depth;
    Point at;
    Color color;
  };
  std::vector<Dot> dots;
  for (const ScenePoint& point : figure.points) {
    if (const auto seen = eye(point.at)) dots.push_back({seen->z(), axes.ToPage(seen->x(), seen->y()), point.color});
  }
  // What is nearer is drawn over what is further away.
  std::ranges::stable_sort(dots, {}, &Dot::depth);
  const double radius = std::clamp(60.0 / std::sqrt(static_cast<double>(dots.size()) + 1.0), 0.6, 1.4);
  for (const Dot& dot : dots) canvas.Disc(dot.at, radius, dot.color);
  for (const SceneLine& line : figure.lines) {
    const auto from = eye(line.from), to = eye(line.to);
    if (!from || !to) continue;
    canvas.Line(axes.ToPage(from->x(), from->y()), axes.ToPage(to->x(), to->y()), line.color, line.width_pt);
  }
  std::vector<Point> at;
  for (const SceneCamera& camera : figure.cameras) {
    const auto seen = eye(camera.scene_from_camera.translation());
    if (seen) at.push_back(axes.ToPage(seen->x(), seen->y()));
  }
  const double length = CameraSize(at) / axes.points_per_unit();
  for (const SceneCamera& camera : figure.cameras) DrawCamera(canvas, axes, eye, camera, length);
}

void DrawScale(Canvas& canvas, const SceneScale& scale, Point left_baseline) {
  constexpr int kSteps = 60;
  constexpr double kWidth = 140.0, kHeight = 9.0;
  const TextStyle small{.size_pt = 10.0};
  double x = left_baseline.x;
  canvas.Text({x, left_baseline.y}, absl::StrCat(scale.label, ": ", scale.low), small);
  x += canvas.TextWidth(absl::StrCat(scale.label, ": ", scale.low), small) + 6.0;
  for (int i = 0; i < kSteps; ++i) {
    canvas.FillRect({x + kWidth * i / kSteps, left_baseline.y - kHeight + 1.0, kWidth / kSteps + 0.3, kHeight},
                    Sequential((i + 0.5) / kSteps));
  }
  canvas.Text({x + kWidth + 6.0, left_baseline.y}, scale.high, small);
}

}  // namespace

absl::Status WriteSceneFigure(const SceneFigure& figure, const std::string& path, const FigureOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_RETURN_IF_ERROR(CheckScene(figure));
  const std::vector<Vector3d> framed = Framed(figure);
  Vector3d low = framed.front(), high = framed.front();
  for (const Vector3d& p : framed) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Eye eye(figure, framed, 0.5 * (low + high), std::max((high - low).norm(), 1e-9));
  Range x, y;
  for (const Vector3d& p : framed) {
    if (const auto seen = eye(p)) {
      x.Include(seen->x());
      y.Include(seen->y());
    }
  }
  const double inner = options.width_pt - kSceneLeft - kSceneRight;
  // Twice: how many rows the legend takes shows only on a canvas.
  CAIRN_ASSIGN_OR_RETURN(Canvas trial, Canvas::Create(path, options.width_pt, 100.0, 1.0));
  const int rows = LayLegend(trial, {kSceneLeft, 0.0, inner, 0.0}, figure.legend, false);
  const double top = kSceneTop + kLegendRow * rows;
  const Rect area{kSceneLeft, top, inner, std::clamp(inner * y.size() / std::max(x.size(), 1e-9) * 1.02, 220.0, inner)};
  const double height = area.bottom() + kSceneBottom + (figure.scale ? kScaleHeight : 0.0);
  CAIRN_ASSIGN_OR_RETURN(Canvas canvas, Canvas::Create(path, options.width_pt, height, options.pixel_scale));
  canvas.Text({kSceneLeft, 24.0}, figure.title, {.size_pt = 14.0, .bold = true});
  canvas.Text({kSceneLeft, 46.0}, figure.subtitle);
  LayLegend(canvas, {kSceneLeft, 66.0, inner, 0.0}, figure.legend, true);
  const Axes axes(area, x, y, true);
  if (eye.perspective()) {
    canvas.StrokeRect(area, kGray, 0.8);
  } else {
    axes.Draw(canvas, absl::StrCat(eye.name(0), " [", figure.unit, "]"),
              absl::StrCat(eye.name(1), " [", figure.unit, "]"));
  }
  canvas.SetClip(area);
  if (eye.perspective()) DrawGround(canvas, axes, eye, figure, framed);
  DrawScene(canvas, axes, eye, figure);
  canvas.ClearClip();
  if (figure.scale) DrawScale(canvas, *figure.scale, {kSceneLeft, height - 8.0});
  return canvas.Finish(options.overwrite);
}

}  // namespace cairn::plot

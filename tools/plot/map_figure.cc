#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"
#include "plot/axes.h"
#include "plot/figures.h"
#include "plot/projection.h"

namespace cairn::plot {
namespace {

constexpr double kMapLeft = 66.0, kMapRight = 24.0, kMapTop = 62.0, kMapBottom = 44.0;

// The mean of the cameras' own "up" (-y). Of cameras that look every way round the horizon this is against gravity.
Vector3d MeanUp(std::span<const PlottedKeyframe> keyframes) {
  Vector3d up = Vector3d::Zero();
  for (const PlottedKeyframe& k : keyframes) up -= k.world_from_camera.RotationMatrix().col(1);
  return up.norm() > 1e-6 ? up.normalized() : Vector3d::UnitZ();
}

struct View2d {
  Projection projection;
  Range x;
  Range y;
};

View2d MakeView(const MapFigure& figure) {
  std::vector<Vector3d> centers;
  for (const PlottedKeyframe& k : figure.keyframes) centers.push_back(k.world_from_camera.translation());
  View2d view;
  view.projection =
      TopView(figure.points_m.empty() ? centers : figure.points_m, figure.up.value_or(MeanUp(figure.keyframes)));
  std::vector<double> xs, ys;
  for (const Vector3d& p : figure.points_m) {
    const Vector3d q = view.projection(p);
    xs.push_back(q.x());
    ys.push_back(q.y());
  }
  view.x = MiddleOf(xs);
  view.y = MiddleOf(ys);
  for (const Vector3d& p : centers) {
    const Vector3d q = view.projection(p);
    view.x.Include(q.x());
    view.y.Include(q.y());
  }
  return view;
}

// A camera from above: its centre and the two ends of its field of view, `length` in units of the map.
std::vector<Point> Frustum(const SE3& world_from_camera, const Projection& projection, const Axes& axes,
                           double length) {
  std::vector<Point> corners;
  for (const Vector3d& corner : {Vector3d(0, 0, 0), Vector3d(-0.6, 0, 1), Vector3d(0.6, 0, 1)}) {
    const Vector3d q = projection(world_from_camera * Vector3d(length * corner));
    corners.push_back(axes.ToPage(q.x(), q.y()));
  }
  return corners;
}

void DrawMap(Canvas& canvas, const Axes& axes, const Projection& projection, const MapFigure& figure) {
  const auto to_page = [&](const Vector3d& p) {
    const Vector3d q = projection(p);
    return axes.ToPage(q.x(), q.y());
  };
  canvas.SetClip(axes.area());
  const double n = static_cast<double>(figure.points_m.size());
  const double radius = std::clamp(60.0 / std::sqrt(n + 1.0), 0.55, 1.3);
  for (const Vector3d& p : figure.points_m) canvas.Disc(to_page(p), radius, Color{0.25, 0.25, 0.30, 0.42});
  const double edge_alpha = std::clamp(60.0 / (1.0 + static_cast<double>(figure.covisible.size())), 0.10, 0.5);
  for (const auto& [i, j] : figure.covisible) {
    canvas.Line(to_page(figure.keyframes[i].world_from_camera.translation()),
                to_page(figure.keyframes[j].world_from_camera.translation()), kGreen.WithAlpha(edge_alpha), 0.7);
  }
  for (std::size_t i = 1; i < figure.keyframes.size(); ++i) {
    const PlottedKeyframe &a = figure.keyframes[i - 1], &b = figure.keyframes[i];
    if (a.group != b.group) continue;
    canvas.Line(to_page(a.world_from_camera.translation()), to_page(b.world_from_camera.translation()),
                CategoryColor(a.group), 1.3);
  }
  const double length = 11.0 / axes.points_per_unit();
  for (const PlottedKeyframe& k : figure.keyframes) {
    const Color color = CategoryColor(k.group);
    canvas.Polygon(Frustum(k.world_from_camera, projection, axes, length), color.WithAlpha(0.18), color, 0.9);
  }
  for (const SE3& query : figure.queries) {
    canvas.Polygon(Frustum(query, projection, axes, length), kVermilion.WithAlpha(0.30), kVermilion, 1.0);
  }
  canvas.ClearClip();
}

absl::Status CheckMap(const MapFigure& figure) {
  if (figure.points_m.empty() && figure.keyframes.empty()) {
    return absl::InvalidArgumentError("map figure: there are neither points nor keyframes to draw");
  }
  for (const Vector3d& p : figure.points_m) {
    if (!p.allFinite()) return absl::InvalidArgumentError("map figure: a point is not finite");
  }
  for (const PlottedKeyframe& k : figure.keyframes) {
    if (!k.world_from_camera.translation().allFinite()) {
      return absl::InvalidArgumentError("map figure: a keyframe's position is not finite");
    }
  }
  for (const auto& [i, j] : figure.covisible) {
    if (i >= figure.keyframes.size() || j >= figure.keyframes.size()) {
      return absl::InvalidArgumentError(
          absl::StrCat("map figure: an edge joins keyframes ", i, " and ", j, " of ", figure.keyframes.size()));
    }
  }
  if (figure.up.has_value() && !(figure.up->norm() > 1e-9)) {
    return absl::InvalidArgumentError("map figure: up must be a direction");
  }
  return absl::OkStatus();
}

std::vector<LegendEntry> MakeLegend(const MapFigure& figure) {
  std::vector<LegendEntry> legend;
  if (!figure.points_m.empty()) legend.push_back({"points", Color{0.25, 0.25, 0.30}, LegendEntry::Mark::kDot, 1.0});
  int groups = 0;
  for (const PlottedKeyframe& k : figure.keyframes) groups = std::max(groups, k.group + 1);
  for (int g = 0; g < groups; ++g) {
    std::string label = g < static_cast<int>(figure.group_labels.size())
                            ? figure.group_labels[static_cast<std::size_t>(g)]
                        : groups == 1 ? "keyframes"
                                      : absl::StrCat("keyframes ", g + 1);
    legend.push_back({std::move(label), CategoryColor(g), LegendEntry::Mark::kFrustum, 1.0});
  }
  if (!figure.covisible.empty()) legend.push_back({"shared points", kGreen, LegendEntry::Mark::kLine, 1.2});
  if (!figure.queries.empty()) legend.push_back({"relocalized", kVermilion, LegendEntry::Mark::kFrustum, 1.0});
  return legend;
}

}  // namespace

absl::Status WriteMapFigure(const MapFigure& figure, const std::string& path, const FigureOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_RETURN_IF_ERROR(CheckMap(figure));
  const View2d view = MakeView(figure);
  const double inner = options.width_pt - kMapLeft - kMapRight;
  const double aspect = view.y.size() / std::max(view.x.size(), 1e-9);
  const Rect area{kMapLeft, kMapTop, inner, std::clamp(inner * aspect * 1.02, 220.0, 1.1 * inner)};
  CAIRN_ASSIGN_OR_RETURN(Canvas canvas,
                         Canvas::Create(path, options.width_pt, area.bottom() + kMapBottom, options.pixel_scale));
  canvas.Text({kMapLeft, 24.0}, figure.title, {.size_pt = 14.0, .bold = true});
  canvas.Text({kMapLeft, 46.0},
              absl::StrFormat("%d keyframes, %d points", figure.keyframes.size(), figure.points_m.size()));
  DrawLegend(canvas, {area.right(), 46.0}, MakeLegend(figure));
  const Axes axes(area, view.x, view.y, true);
  const std::string unit = figure.metric ? " [m]" : " [map units]";
  axes.Draw(canvas, view.projection.names[0] + unit, view.projection.names[1] + unit);
  DrawMap(canvas, axes, view.projection, figure);
  if (figure.metric) axes.DrawScaleBar(canvas);
  return canvas.Finish(options.overwrite);
}

}  // namespace cairn::plot

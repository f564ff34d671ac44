#include <algorithm>
#include <cmath>

#include "plot/axes.h"
#include "plot/canvas.h"
#include "plot/inspect_figures.h"

namespace cairn::plot {
namespace {

constexpr double kHeatLeft = 66.0, kHeatRight = 24.0, kHeatTop = 62.0, kHeatBottom = 76.0;

// From purple (none) to orange (all), pale enough for what is drawn on top.
Color Heat(double share) { return Sequential(0.15 + 0.85 * share).WithAlpha(0.55); }

void DrawArrow(Canvas& canvas, Point at, const Eigen::Vector2d& direction, Color color) {
  constexpr double kLength = 11.0;
  const Point tip{at.x + kLength * direction.x(), at.y - kLength * direction.y()};
  canvas.Line(at, tip, color, 1.3);
  canvas.Disc(at, 2.2, color);
}

void DrawKey(Canvas& canvas, const Rect& bar) {
  constexpr int kSteps = 50;
  for (int i = 0; i < kSteps; ++i) {
    canvas.FillRect({bar.x + bar.width * i / kSteps, bar.y, bar.width / kSteps, bar.height}, Heat((i + 0.5) / kSteps));
  }
  const TextStyle small{.size_pt = 10.0};
  canvas.Text({bar.x - 26.0, bar.bottom() - 0.5}, "0 %", small);
  canvas.Text({bar.right() + 6.0, bar.bottom() - 0.5}, "100 % of the views found without their own keyframe", small);
}

}  // namespace

absl::Status WriteHeatFigure(const HeatFigure& figure, const std::string& path, const FigureOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  if (figure.cells.empty() || !(figure.cell_size > 0.0)) {
    return absl::InvalidArgumentError("heat figure: there is no cell to draw");
  }
  Range x, y;
  for (const HeatCell& cell : figure.cells) {
    for (const double step : {0.0, figure.cell_size}) {
      x.Include(cell.x + step);
      y.Include(cell.y + step);
    }
  }
  const double inner = options.width_pt - kHeatLeft - kHeatRight;
  const Rect area{kHeatLeft, kHeatTop, inner, std::clamp(inner * y.size() / std::max(x.size(), 1e-9), 220.0, inner)};
  CAIRN_ASSIGN_OR_RETURN(Canvas canvas,
                         Canvas::Create(path, options.width_pt, area.bottom() + kHeatBottom, options.pixel_scale));
  canvas.Text({kHeatLeft, 24.0}, figure.title, {.size_pt = 14.0, .bold = true});
  canvas.Text({kHeatLeft, 46.0}, figure.subtitle);
  const Axes axes(area, x, y, true);
  axes.Draw(canvas, absl::StrCat(figure.axes[0], " [", figure.axis_unit, "]"),
            absl::StrCat(figure.axes[1], " [", figure.axis_unit, "]"));
  canvas.SetClip(area);
  for (const Eigen::Vector2d& point : figure.points) {
    canvas.Disc(axes.ToPage(point.x(), point.y()), 0.7, Color{0.25, 0.25, 0.30, 0.30});
  }
  for (const HeatCell& cell : figure.cells) {
    const Point low = axes.ToPage(cell.x, cell.y);
    const Point high = axes.ToPage(cell.x + figure.cell_size, cell.y + figure.cell_size);
    const Rect rect{low.x, high.y, high.x - low.x, low.y - high.y};
    canvas.FillRect(rect, Heat(cell.share));
    canvas.StrokeRect(rect, Color{1, 1, 1}, 1.0);
    canvas.Text({rect.x + 4.0, rect.y + 12.0}, cell.label, {.size_pt = 9.0});
  }
  for (const HeatMark& mark : figure.marks) {
    DrawArrow(canvas, axes.ToPage(mark.at.x(), mark.at.y()), mark.direction, mark.good ? kInk : kVermilion);
  }
  canvas.ClearClip();
  DrawKey(canvas, {kHeatLeft + 30.0, area.bottom() + 52.0, 120.0, 9.0});
  return canvas.Finish(options.overwrite);
}

}  // namespace cairn::plot

#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"
#include "plot/canvas.h"
#include "plot/inspect_figures.h"

namespace cairn::plot {
namespace {

constexpr double kViewMargin = 24.0, kViewTop = 62.0, kViewBottom = 58.0;
constexpr double kWorstShown_px = 4.0;  // from here on errors have the last colour

void Ring(Canvas& canvas, Point center, double radius, Color color, double width) {
  std::vector<Point> points;
  for (int i = 0; i <= 16; ++i) {
    const double angle = 2.0 * M_PI * i / 16;
    points.push_back({center.x + radius * std::cos(angle), center.y + radius * std::sin(angle)});
  }
  canvas.Polyline(points, color, width);
}

void DrawErrorScale(Canvas& canvas, const Rect& bar) {
  constexpr int kSteps = 64;
  for (int i = 0; i < kSteps; ++i) {
    canvas.FillRect({bar.x + bar.width * i / kSteps, bar.y, bar.width / kSteps + 0.5, bar.height},
                    Sequential((i + 0.5) / kSteps));
  }
  const TextStyle style{.size_pt = 10.0, .align = Align::kCenter};
  for (int px = 0; px <= static_cast<int>(kWorstShown_px); ++px) {
    const bool last = px == static_cast<int>(kWorstShown_px);
    canvas.Text({bar.x + bar.width * px / kWorstShown_px, bar.bottom() + 14.0}, absl::StrCat(px, last ? "+" : ""),
                style);
  }
  canvas.Text(
      {bar.right() + 14.0, bar.bottom() - 1.0},
      absl::StrFormat("px reprojection error, drawn %.0f times as long; rings: features without a point", kErrorScale),
      {.size_pt = 10.0});
}

}  // namespace

absl::Status WriteViewFigure(const ViewFigure& figure, const std::string& path, const FigureOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  if (figure.width_px <= 0 || figure.height_px <= 0) {
    return absl::InvalidArgumentError("view figure: the image has no positive size");
  }
  const double inner = options.width_pt - 2.0 * kViewMargin, scale = inner / figure.width_px;
  const Rect area{kViewMargin, kViewTop, inner, scale * figure.height_px};
  CAIRN_ASSIGN_OR_RETURN(Canvas canvas,
                         Canvas::Create(path, options.width_pt, area.bottom() + kViewBottom, options.pixel_scale));
  canvas.Text({kViewMargin, 24.0}, figure.title, {.size_pt = 14.0, .bold = true});
  canvas.Text({kViewMargin, 46.0}, figure.subtitle);
  canvas.FillRect(area, Color{0.965, 0.965, 0.97});
  canvas.SetClip(area);
  const auto to_page = [&](const Eigen::Vector2d& px) {
    return Point{area.x + scale * (px.x() + 0.5), area.y + scale * (px.y() + 0.5)};
  };
  for (const bool with_point : {false, true}) {
    for (const ViewMark& mark : figure.marks) {
      if (mark.has_point != with_point) continue;
      const Point at = to_page(mark.pixel);
      if (!with_point) {
        Ring(canvas, at, std::max(1.2, scale * mark.radius_px), kGray.WithAlpha(0.45), 0.5);
        continue;
      }
      const Color color = Sequential(mark.error_px.norm() / kWorstShown_px);
      canvas.Line(at, to_page(mark.pixel - kErrorScale * mark.error_px), color.WithAlpha(0.8), 0.9);
      canvas.Disc(at, 1.9, color);
    }
  }
  canvas.ClearClip();
  canvas.StrokeRect(area, kGray, 0.8);
  DrawErrorScale(canvas, {area.x + 4.0, area.bottom() + 16.0, 150.0, 9.0});
  return canvas.Finish(options.overwrite);
}

}  // namespace cairn::plot

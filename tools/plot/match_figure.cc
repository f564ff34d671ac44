#include <algorithm>
#include <cmath>

#include "plot/canvas.h"
#include "plot/inspect_figures.h"

namespace cairn::plot {
namespace {

constexpr double kMatchMargin = 20.0, kMatchTop = 84.0, kMatchGap = 14.0, kMatchBottom = 40.0;

struct Side {
  Rect area;
  double scale = 1.0;
  Point ToPage(const Eigen::Vector2d& px) const {
    return {area.x + scale * (px.x() + 0.5), area.y + scale * (px.y() + 0.5)};
  }
};

Side MakeSide(double x, double width, const MatchedView& view) {
  const double scale = width / view.width_px;
  return {{x, kMatchTop, width, scale * view.height_px}, scale};
}

void DrawSide(Canvas& canvas, const Side& side, const MatchedView& view) {
  canvas.Text({side.area.x, side.area.y - 8.0}, view.label, {.size_pt = 11.0, .bold = true});
  if (view.image.empty()) {
    canvas.FillRect(side.area, Color{0.965, 0.965, 0.97});
  } else {
    canvas.Image(view.image, side.area);
  }
  canvas.SetClip(side.area);
  for (const Eigen::Vector2d& feature : view.features) canvas.Disc(side.ToPage(feature), 1.0, kGray.WithAlpha(0.6));
  canvas.ClearClip();
  canvas.StrokeRect(side.area, kGray, 0.8);
}

}  // namespace

absl::Status WriteMatchFigure(const MatchFigure& figure, const std::string& path, const FigureOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  const bool alone = figure.right.width_px == 0 && figure.right.height_px == 0;
  for (const MatchedView* view : {&figure.left, &figure.right}) {
    if (alone && view == &figure.right) continue;
    if (view->width_px <= 0 || view->height_px <= 0) {
      return absl::InvalidArgumentError("match figure: an image has no positive size");
    }
    if (!view->image.empty() && view->image.type() != CV_8UC1) {
      return absl::InvalidArgumentError("match figure: images are 8-bit grey");
    }
  }
  const double width = (options.width_pt - 2.0 * kMatchMargin - kMatchGap) / 2.0;
  const Side left = MakeSide(kMatchMargin, width, figure.left);
  const Side right = alone ? Side() : MakeSide(kMatchMargin + width + kMatchGap, width, figure.right);
  const double bottom = std::max(left.area.bottom(), right.area.bottom());
  CAIRN_ASSIGN_OR_RETURN(Canvas canvas,
                         Canvas::Create(path, options.width_pt, bottom + kMatchBottom, options.pixel_scale));
  canvas.Text({kMatchMargin, 26.0}, figure.title, {.size_pt = 14.0, .bold = true});
  canvas.Text({kMatchMargin, 48.0}, figure.subtitle);
  DrawSide(canvas, left, figure.left);
  if (!alone) DrawSide(canvas, right, figure.right);
  int inliers = 0;
  for (const bool inlier : {false, true}) {
    for (const PlottedMatch& match : figure.matches) {
      if (match.inlier != inlier) continue;
      inliers += inlier ? 1 : 0;
      const Color color = inlier ? kGreen : kVermilion;
      const Point a = left.ToPage(match.left), b = right.ToPage(match.right);
      canvas.Line(a, b, color.WithAlpha(inlier ? 0.45 : 0.30), 0.6);
      canvas.Disc(a, 1.8, color);
      canvas.Disc(b, 1.8, color);
    }
  }
  canvas.Text(
      {kMatchMargin, bottom + 24.0},
      alone ? "gray: features"
            : absl::StrCat("green: ", inliers, " matches that agree with a pose; orange: ",
                           figure.matches.size() - static_cast<std::size_t>(inliers), " that do not; gray: features"),
      {.size_pt = 10.0});
  return canvas.Finish(options.overwrite);
}

}  // namespace cairn::plot

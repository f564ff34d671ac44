#include <algorithm>

#include "plot/axes.h"
#include "plot/figures.h"

namespace cairn::plot {
namespace {

Range Span(double low, double high) {
  Range range;
  range.Include(low);
  range.Include(high);
  return range;
}

void DrawResponse(Canvas& canvas, const Rect& area, const PhotometricFigure& figure) {
  const Axes axes(area, Span(0.0, 255.0), Span(0.0, 255.0), false);
  axes.Draw(canvas, "gray value", "light (inverse response)");
  canvas.SetClip(area);
  const int most =
      figure.intensity_seen.empty() ? 0 : *std::max_element(figure.intensity_seen.begin(), figure.intensity_seen.end());
  for (std::size_t i = 0; most > 0 && i < figure.intensity_seen.size(); ++i) {
    const double height = 80.0 * figure.intensity_seen[i] / most;  // in units of the axis
    const Point foot = axes.ToPage(static_cast<double>(i), 0.0), top = axes.ToPage(static_cast<double>(i), height);
    canvas.Line(foot, top, kSky.WithAlpha(0.5), 1.2);
  }
  canvas.Polyline({axes.ToPage(0.0, 0.0), axes.ToPage(255.0, 255.0)}, kGray, 1.0, true);
  std::vector<Point> line;
  for (std::size_t i = 0; i < 256; ++i) {
    line.push_back(axes.ToPage(static_cast<double>(i), figure.inverse_response[i]));
  }
  canvas.Polyline(line, kBlue, 2.0);
  canvas.ClearClip();
}

void DrawVignette(Canvas& canvas, const Rect& area, const PhotometricFigure& figure) {
  const double low = *std::min_element(figure.vignette.begin(), figure.vignette.end());
  const double high = *std::max_element(figure.vignette.begin(), figure.vignette.end());
  const Axes axes(area, Span(0.0, 1.0), Span(std::min(low, 0.5), std::max(high, 1.0)), false);
  axes.Draw(canvas, "radius (1: corner of the image)", "vignette");
  std::vector<Point> line;
  const double steps = static_cast<double>(figure.vignette.size() - 1);
  for (std::size_t i = 0; i < figure.vignette.size(); ++i) {
    line.push_back(axes.ToPage(static_cast<double>(i) / steps, figure.vignette[i]));
  }
  canvas.SetClip(area);
  canvas.Polyline(line, kVermilion, 2.0);
  canvas.ClearClip();
}

}  // namespace

absl::Status WritePhotometricFigure(const PhotometricFigure& figure, const std::string& path,
                                    const FigureOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  if (figure.vignette.size() < 2) {
    return absl::InvalidArgumentError("photometric figure: the vignette needs values at two radii at least");
  }
  const double height_pt = 0.46 * options.width_pt;
  CAIRN_ASSIGN_OR_RETURN(Canvas canvas, Canvas::Create(path, options.width_pt, height_pt, options.pixel_scale));
  canvas.Text({66.0, 26.0}, figure.title, {.size_pt = 14.0, .bold = true});
  const double panel = 0.5 * options.width_pt - 66.0 - 20.0, tall = height_pt - 44.0 - 44.0;
  DrawResponse(canvas, {66.0, 44.0, panel, tall}, figure);
  DrawVignette(canvas, {0.5 * options.width_pt + 62.0, 44.0, panel, tall}, figure);
  return canvas.Finish(options.overwrite);
}

}  // namespace cairn::plot

#include <algorithm>
#include <cmath>
#include <limits>

#include "plot/axes.h"
#include "plot/figures.h"

namespace cairn::plot {
namespace {

constexpr double kLogFloor = 1e-12;

// Labels of a logarithmic axis: powers of ten, drawn by hand because Axes is linear in the logarithm.
void DrawLogTicks(Canvas& canvas, const Axes& axes) {
  const Rect& area = axes.area();
  canvas.FillRect({area.x - 40.0, area.y - 8.0, 39.0, area.height + 16.0}, Color{1, 1, 1});
  for (double k = std::ceil(axes.y().low); k <= axes.y().high; k += 1.0) {
    const Point p = axes.ToPage(axes.x().low, k);
    const double value = std::pow(10.0, k);
    canvas.Text({area.x - 6.0, p.y + 3.6}, TickLabel(value, value), {.size_pt = 10.0, .align = Align::kRight});
  }
}

}  // namespace

absl::Status WriteErrorFigure(const ErrorFigure& figure, const std::string& path, const FigureOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  Range x, y;
  const auto value_of = [&](double v) {
    if (!figure.log_scale) return v;
    return v > kLogFloor ? std::log10(v) : std::numeric_limits<double>::quiet_NaN();
  };
  double start_s = std::numeric_limits<double>::infinity();
  for (const ErrorSeries& series : figure.series) {
    if (series.time_s.size() != series.value.size()) {
      return absl::InvalidArgumentError(absl::StrCat("error figure: series \"", series.label, "\" has ",
                                                     series.time_s.size(), " times and ", series.value.size(),
                                                     " values"));
    }
    for (const double t : series.time_s) start_s = std::min(start_s, t);
  }
  for (const ErrorSeries& series : figure.series) {
    for (std::size_t i = 0; i < series.value.size(); ++i) {
      if (!std::isfinite(value_of(series.value[i]))) continue;
      x.Include(series.time_s[i] - start_s);
      y.Include(value_of(series.value[i]));
    }
  }
  if (x.empty()) return absl::InvalidArgumentError("error figure: there is no finite value to draw");
  if (!figure.log_scale) y.Include(0.0);

  const double height_pt = 0.42 * options.width_pt;
  CAIRN_ASSIGN_OR_RETURN(Canvas canvas, Canvas::Create(path, options.width_pt, height_pt, options.pixel_scale));
  const Axes axes({66.0, 44.0, options.width_pt - 66.0 - 24.0, height_pt - 44.0 - 44.0}, x, y, false);
  canvas.Text({66.0, 26.0}, figure.title, {.size_pt = 14.0, .bold = true});
  std::vector<LegendEntry> legend;
  for (std::size_t k = 0; k < figure.series.size(); ++k) {
    legend.push_back({figure.series[k].label, CategoryColor(static_cast<int>(k)), LegendEntry::Mark::kLine, 1.6});
  }
  if (figure.series.size() > 1 || !figure.series[0].label.empty()) {
    DrawLegend(canvas, {axes.area().right(), 26.0}, legend);
  }
  axes.Draw(canvas, "time [s]", figure.value_label);
  if (figure.log_scale) DrawLogTicks(canvas, axes);
  canvas.SetClip(axes.area());
  for (std::size_t k = 0; k < figure.series.size(); ++k) {
    const ErrorSeries& series = figure.series[k];
    std::vector<Point> line;
    for (std::size_t i = 0; i < series.value.size(); ++i) {
      const double v = value_of(series.value[i]);
      if (std::isfinite(v) && std::isfinite(series.time_s[i])) {
        line.push_back(axes.ToPage(series.time_s[i] - start_s, v));
        continue;
      }
      canvas.Polyline(line, legend[k].color, 1.4);
      line.clear();
    }
    canvas.Polyline(line, legend[k].color, 1.4);
  }
  canvas.ClearClip();
  return canvas.Finish(options.overwrite);
}

}  // namespace cairn::plot

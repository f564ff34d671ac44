#include <algorithm>
#include <cmath>

#include "plot/axes.h"
#include "plot/canvas.h"
#include "plot/inspect_figures.h"

namespace cairn::plot {
namespace {

constexpr std::size_t kColumns = 3;
constexpr double kPanelHeight = 190.0, kTitleHeight = 44.0;

// Without its last words if there is no room for them.
std::string Fitting(Canvas& canvas, const std::string& label, double width) {
  std::string text = label;
  while (canvas.TextWidth(text) > width) {
    const std::size_t end = text.find_last_of(' ', text.size() - (text == label ? 1 : 5));
    if (end == std::string::npos || end == 0) return text;
    text = text.substr(0, end) + " ...";
  }
  return text;
}

void DrawHistogram(Canvas& canvas, const Rect& at, const HistogramPanel& panel) {
  canvas.Text({at.x + 50.0, at.y + 14.0}, panel.title, {.size_pt = 11.0, .bold = true});
  const Rect area{at.x + 50.0, at.y + 24.0, at.width - 62.0, at.height - 68.0};
  if (panel.bins.empty()) {
    canvas.StrokeRect(area, kGrid);
    canvas.Text({area.x + area.width / 2.0, area.y + area.height / 2.0}, "none",
                {.size_pt = 11.0, .color = kGray, .align = Align::kCenter});
    return;
  }
  const double step = panel.step > 0.0 ? panel.step : 1.0;
  Range x, y;
  x.Include(panel.low);
  x.Include(panel.low + step * static_cast<double>(panel.bins.size()));
  y.Include(0.0);
  y.Include(static_cast<double>(std::max<std::int64_t>(1, *std::ranges::max_element(panel.bins))));
  const Axes axes(area, x, y, false);
  axes.Draw(canvas, Fitting(canvas, panel.label, area.width + 16.0), "");
  canvas.SetClip(area);
  for (std::size_t i = 0; i < panel.bins.size(); ++i) {
    const Point top = axes.ToPage(panel.low + step * static_cast<double>(i), static_cast<double>(panel.bins[i]));
    const Point end = axes.ToPage(panel.low + step * static_cast<double>(i + 1), 0.0);
    canvas.FillRect({top.x, top.y, std::max(0.5, end.x - top.x - 0.6), end.y - top.y}, kBlue.WithAlpha(0.75));
  }
  canvas.Line(axes.ToPage(panel.marked, 0.0), {axes.ToPage(panel.marked, 0.0).x, area.y}, kVermilion, 1.2);
  canvas.ClearClip();
}

}  // namespace

absl::Status WriteHistogramFigure(const HistogramFigure& figure, const std::string& path,
                                  const FigureOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  if (figure.panels.empty()) return absl::InvalidArgumentError("histogram figure: there is no panel to draw");
  const std::size_t rows = (figure.panels.size() + kColumns - 1) / kColumns;
  const double height = kTitleHeight + kPanelHeight * static_cast<double>(rows);
  CAIRN_ASSIGN_OR_RETURN(Canvas canvas, Canvas::Create(path, options.width_pt, height, options.pixel_scale));
  canvas.Text({24.0, 26.0}, figure.title, {.size_pt = 14.0, .bold = true});
  canvas.Text({options.width_pt - 24.0, 26.0}, "line: median",
              {.size_pt = 10.0, .color = kVermilion, .align = Align::kRight});
  const double width = options.width_pt / static_cast<double>(kColumns);
  for (std::size_t i = 0; i < figure.panels.size(); ++i) {
    const std::size_t row = i / kColumns, column = i % kColumns;
    DrawHistogram(canvas,
                  {static_cast<double>(column) * width, kTitleHeight + static_cast<double>(row) * kPanelHeight, width,
                   kPanelHeight},
                  figure.panels[i]);
  }
  return canvas.Finish(options.overwrite);
}

}  // namespace cairn::plot

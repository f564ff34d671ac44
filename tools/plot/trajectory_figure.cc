#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"
#include "plot/axes.h"
#include "plot/figures.h"
#include "plot/projection.h"

namespace cairn::plot {

absl::Status FigureOptions::Validate() const {
  if (!(width_pt >= 200.0 && width_pt <= 10000.0)) {
    return absl::InvalidArgumentError(absl::StrCat("width_pt must be in [200, 10000], is ", width_pt));
  }
  if (!(pixel_scale >= 0.1 && pixel_scale <= 20.0)) {
    return absl::InvalidArgumentError(absl::StrCat("pixel_scale must be in [0.1, 20], is ", pixel_scale));
  }
  return absl::OkStatus();
}

namespace {

constexpr double kLeft = 66.0, kRight = 96.0, kTop = 62.0, kBottom = 44.0, kGap = 46.0;

// A line is broken where the time between two samples is several times the usual one.
TimeNs GapNs(std::vector<TimeNs> times) {
  std::vector<TimeNs> steps;
  for (std::size_t i = 1; i < times.size(); ++i) steps.push_back(times[i] - times[i - 1]);
  if (steps.empty()) return 0;
  const auto at = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() * 9 / 10);
  std::nth_element(steps.begin(), at, steps.end());
  return 5 * *at;
}

struct Layout {
  Rect main;
  Rect side;  // of no height: none
  double height_pt = 0.0;
};

Layout MakeLayout(double width_pt, const Range& x, const Range& y, const Range& z, bool with_side) {
  const double inner = width_pt - kLeft - kRight;
  const double extent = std::max(x.size(), 1e-6);
  Layout layout;
  layout.main = {kLeft, kTop, inner, std::clamp(inner * y.size() / extent * 1.02, 160.0, 0.95 * inner)};
  layout.height_pt = layout.main.bottom() + kBottom;
  if (with_side) {
    layout.side = {kLeft, layout.main.bottom() + kGap, inner,
                   std::clamp(inner * z.size() / extent * 1.02, 90.0, 0.4 * inner)};
    layout.height_pt = layout.side.bottom() + kBottom;
  }
  return layout;
}

struct Panel {
  int horizontal = 0;  // components of the projected positions
  int vertical = 1;
};

void DrawPanel(Canvas& canvas, const Axes& axes, const Panel& panel, const TrajectoryFigure& figure,
               const Projection& projection, double color_max_m) {
  const auto to_page = [&](const Vector3d& p) {
    const Vector3d q = projection(p);
    return axes.ToPage(q[panel.horizontal], q[panel.vertical]);
  };
  axes.Draw(canvas, projection.names[panel.horizontal] + " [m]", projection.names[panel.vertical] + " [m]");
  canvas.SetClip(axes.area());

  std::vector<TimeNs> times;
  for (const auto& [time, position] : figure.groundtruth) times.push_back(time);
  TimeNs gap_ns = GapNs(times);
  std::vector<Point> line;
  for (std::size_t i = 0; i < figure.groundtruth.size(); ++i) {
    if (i > 0 && times[i] - times[i - 1] > gap_ns) {
      canvas.Polyline(line, Color{0.66, 0.66, 0.69}, 3.4);
      line.clear();
    }
    line.push_back(to_page(figure.groundtruth[i].second));
  }
  canvas.Polyline(line, Color{0.66, 0.66, 0.69}, 3.4);

  times.clear();
  for (const PlottedPose& pose : figure.estimate) times.push_back(pose.time_ns);
  gap_ns = GapNs(times);
  const auto color = [&](double error_m) { return Sequential(color_max_m > 0.0 ? error_m / color_max_m : 0.0); };
  for (std::size_t i = 1; i < figure.estimate.size(); ++i) {
    if (times[i] - times[i - 1] > gap_ns) continue;
    const PlottedPose &a = figure.estimate[i - 1], &b = figure.estimate[i];
    canvas.Line(to_page(a.position_m), to_page(b.position_m), color(0.5 * (a.error_m + b.error_m)), 1.8);
  }
  if (figure.estimate.size() <= 600) {
    for (const PlottedPose& pose : figure.estimate) canvas.Disc(to_page(pose.position_m), 1.7, color(pose.error_m));
  }
  if (!figure.estimate.empty()) {
    const Point start = to_page(figure.estimate.front().position_m);
    canvas.Disc(start, 4.6, Color{1, 1, 1});
    canvas.Disc(start, 3.4, kInk);
  }
  canvas.ClearClip();
}

void DrawColorBar(Canvas& canvas, const Rect& bar, double max_m) {
  const int steps = 120;
  for (int i = 0; i < steps; ++i) {
    const double h = bar.height / steps;
    canvas.FillRect({bar.x, bar.bottom() - (i + 1) * h, bar.width, h + 0.4}, Sequential((i + 0.5) / steps));
  }
  canvas.StrokeRect(bar, kGray, 0.8);
  const Range range{.low = 0.0, .high = max_m, .count = 2};
  const std::vector<double> ticks = Ticks(range, 5);
  const double step = ticks.size() > 1 ? ticks[1] - ticks[0] : 1.0;
  for (const double t : ticks) {
    const double y = bar.bottom() - t / max_m * bar.height;
    canvas.Line({bar.right(), y}, {bar.right() + 3.0, y}, kGray, 0.8);
    canvas.Text({bar.right() + 6.0, y + 3.6}, TickLabel(t, step), {.size_pt = 10.0});
  }
  canvas.Text({bar.x, bar.y - 9.0}, "error [m]", {.size_pt = 10.0});
}

absl::Status CheckTrajectory(const TrajectoryFigure& figure) {
  if (figure.estimate.empty()) return absl::InvalidArgumentError("trajectory figure: the estimate is empty");
  for (const PlottedPose& pose : figure.estimate) {
    if (!pose.position_m.allFinite()) return absl::InvalidArgumentError("trajectory figure: a position is not finite");
  }
  for (const auto& [time, position] : figure.groundtruth) {
    if (!position.allFinite()) return absl::InvalidArgumentError("trajectory figure: a true position is not finite");
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status WriteTrajectoryFigure(const TrajectoryFigure& figure, const std::string& path,
                                   const FigureOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_RETURN_IF_ERROR(CheckTrajectory(figure));
  std::vector<Vector3d> positions;
  for (const auto& [time, position] : figure.groundtruth) positions.push_back(position);
  if (positions.empty()) {
    for (const PlottedPose& pose : figure.estimate) positions.push_back(pose.position_m);
  }
  const Projection projection = PrincipalPlane(positions);
  Range range[3];
  double sum = 0.0, max_m = 0.0;
  for (const PlottedPose& pose : figure.estimate) {
    positions.push_back(pose.position_m);
    sum += pose.error_m * pose.error_m;
    max_m = std::max(max_m, pose.error_m);
  }
  for (const Vector3d& p : positions) {
    const Vector3d q = projection(p);
    for (int k = 0; k < 3; ++k) range[k].Include(q[k]);
  }
  const bool with_side =
      figure.view == View::kTopAndSide ||
      (figure.view == View::kAuto && range[2].size() > 0.05 * std::max(range[0].size(), range[1].size()));
  const Layout layout = MakeLayout(options.width_pt, range[0], range[1], range[2], with_side);
  CAIRN_ASSIGN_OR_RETURN(Canvas canvas, Canvas::Create(path, options.width_pt, layout.height_pt, options.pixel_scale));

  canvas.Text({kLeft, 24.0}, figure.title, {.size_pt = 14.0, .bold = true});
  const double rmse_m = std::sqrt(sum / static_cast<double>(figure.estimate.size()));
  canvas.Text({kLeft, 46.0}, absl::StrFormat("RMSE %.4f m, max %.3f m, n = %d", rmse_m, max_m, figure.estimate.size()));
  std::vector<LegendEntry> legend;
  if (!figure.groundtruth.empty()) {
    legend.push_back({figure.groundtruth_label, Color{0.66, 0.66, 0.69}, LegendEntry::Mark::kLine, 3.4});
  }
  legend.push_back({figure.estimate_label, Sequential(0.35), LegendEntry::Mark::kLine, 1.8});
  legend.push_back({"start", kInk, LegendEntry::Mark::kDot, 1.0});
  DrawLegend(canvas, {layout.main.right(), 46.0}, legend);

  const Axes main(layout.main, range[0], range[1], true);
  DrawPanel(canvas, main, {0, 1}, figure, projection, max_m);
  main.DrawScaleBar(canvas);
  if (with_side) DrawPanel(canvas, Axes(layout.side, range[0], range[2], true), {0, 2}, figure, projection, max_m);
  if (max_m > 0.0) {
    const double height = std::min(layout.main.height - 20.0, 260.0);
    DrawColorBar(canvas, {layout.main.right() + 22.0, layout.main.y + 20.0, 12.0, height}, max_m);
  }
  return canvas.Finish(options.overwrite);
}

}  // namespace cairn::plot

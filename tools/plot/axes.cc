#include "plot/axes.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "absl/strings/str_format.h"

namespace cairn::plot {
namespace {

constexpr double kTextSize = 10.0;

double Step(double size, int count) {
  const double raw = size / std::max(count, 1);
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= raw * 0.999) return factor * power;
  }
  return 10.0 * power;
}

Range Padded(Range range) {
  if (range.empty()) return {.low = -1.0, .high = 1.0, .count = 2};
  const double size = std::max(range.size(), 1e-6 * std::max({1e-3, std::abs(range.low), std::abs(range.high)}));
  const double pad = 0.05 * size;
  return {.low = range.low - pad, .high = range.high + pad, .count = range.count};
}

}  // namespace

void Range::Include(double value) {
  if (!std::isfinite(value)) return;
  low = count == 0 ? value : std::min(low, value);
  high = count == 0 ? value : std::max(high, value);
  ++count;
}

Range MiddleOf(std::vector<double> values) {
  Range range;
  if (values.empty()) return range;
  std::sort(values.begin(), values.end());
  range.Include(values[values.size() / 50]);
  range.Include(values[values.size() - 1 - values.size() / 50]);
  return range;
}

std::vector<double> Ticks(const Range& range, int count) {
  std::vector<double> ticks;
  if (!(range.size() > 0.0)) return ticks;
  const double step = Step(range.size(), count);
  for (double k = std::ceil(range.low / step - 1e-9); k * step <= range.high + 1e-9 * step; k += 1.0) {
    ticks.push_back(k * step);
  }
  return ticks;
}

std::string TickLabel(double value, double step) {
  const int decimals = std::clamp(static_cast<int>(std::ceil(-std::log10(step) - 1e-9)), 0, 9);
  if (std::abs(value) < 0.5 * step) value = 0.0;
  const std::string text = absl::StrFormat("%.*f", decimals, std::abs(value));
  return value < 0.0 ? "\u2212" + text : text;
}

Axes::Axes(const Rect& area, Range x, Range y, bool equal_scale) : area_(area), x_(Padded(x)), y_(Padded(y)) {
  scale_x_ = area_.width / x_.size();
  scale_y_ = area_.height / y_.size();
  if (!equal_scale) return;
  const double scale = std::min(scale_x_, scale_y_);
  const auto widen = [scale](Range& range, double length) {
    const double extra = 0.5 * (length / scale - range.size());
    range.low -= extra;
    range.high += extra;
  };
  widen(x_, area_.width);
  widen(y_, area_.height);
  scale_x_ = scale_y_ = scale;
}

Point Axes::ToPage(double x, double y) const {
  return {area_.x + (x - x_.low) * scale_x_, area_.bottom() - (y - y_.low) * scale_y_};
}

void Axes::Draw(Canvas& canvas, const std::string& x_label, const std::string& y_label) const {
  const std::vector<double> ticks_x = Ticks(x_, std::max(2, static_cast<int>(area_.width / 80.0)));
  const std::vector<double> ticks_y = Ticks(y_, std::max(2, static_cast<int>(area_.height / 42.0)));
  const double step_x = ticks_x.size() > 1 ? ticks_x[1] - ticks_x[0] : 1.0;
  const double step_y = ticks_y.size() > 1 ? ticks_y[1] - ticks_y[0] : 1.0;
  for (const double t : ticks_x) {
    const Point p = ToPage(t, y_.low);
    canvas.Line({p.x, area_.y}, {p.x, area_.bottom()}, kGrid, 0.7);
    canvas.Text({p.x, area_.bottom() + 14.0}, TickLabel(t, step_x), {.size_pt = kTextSize, .align = Align::kCenter});
  }
  for (const double t : ticks_y) {
    const Point p = ToPage(x_.low, t);
    canvas.Line({area_.x, p.y}, {area_.right(), p.y}, kGrid, 0.7);
    canvas.Text({area_.x - 6.0, p.y + 3.6}, TickLabel(t, step_y), {.size_pt = kTextSize, .align = Align::kRight});
  }
  canvas.StrokeRect(area_, kGray, 0.8);
  canvas.Text({area_.x + 0.5 * area_.width, area_.bottom() + 30.0}, x_label, {.align = Align::kCenter});
  canvas.Text({area_.x - 44.0, area_.y + 0.5 * area_.height}, y_label,
              {.align = Align::kCenter, .angle_rad = -std::numbers::pi / 2});
}

void Axes::DrawScaleBar(Canvas& canvas) const {
  const double length = Step(x_.size() / 5.0, 1);
  const double width = length * scale_x_;
  // Below the frame, where no data are.
  const Point left{area_.right() - width, area_.bottom() + 34.0};
  canvas.Line(left, {left.x + width, left.y}, kInk, 2.0);
  for (const double x : {left.x, left.x + width}) canvas.Line({x, left.y - 3.0}, {x, left.y + 3.0}, kInk, 1.2);
  canvas.Text({left.x + 0.5 * width, left.y - 7.0}, TickLabel(length, length) + " m",
              {.size_pt = kTextSize, .align = Align::kCenter});
}

void DrawLegend(Canvas& canvas, Point right_baseline, const std::vector<LegendEntry>& entries) {
  const TextStyle style{.size_pt = 10.5};
  double x = right_baseline.x;
  const double y = right_baseline.y;
  for (auto entry = entries.rbegin(); entry != entries.rend(); ++entry) {
    x -= canvas.TextWidth(entry->label, style);
    canvas.Text({x, y}, entry->label, style);
    x -= 6.0;
    const double middle = y - 3.8;
    switch (entry->mark) {
      case LegendEntry::Mark::kLine:
        canvas.Line({x - 20.0, middle}, {x, middle}, entry->color, entry->width_pt);
        break;
      case LegendEntry::Mark::kDot:
        canvas.Disc({x - 5.0, middle}, 2.2, entry->color);
        break;
      case LegendEntry::Mark::kFrustum:
        canvas.Polygon({{x - 14.0, middle}, {x, middle - 5.0}, {x, middle + 5.0}}, entry->color.WithAlpha(0.25),
                       entry->color, 1.2);
        break;
    }
    x -= (entry->mark == LegendEntry::Mark::kDot ? 10.0 : 20.0) + 18.0;
  }
}

}  // namespace cairn::plot

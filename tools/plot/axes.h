// A panel with axes: from data coordinates (x right, y up) to the page, with ticks at round numbers.
#pragma once

#include <string>
#include <vector>

#include "plot/canvas.h"

namespace cairn::plot {

struct Range {
  double low = 0.0;
  double high = 0.0;

  double size() const { return high - low; }
  // Nothing but finite values counts.
  void Include(double value);
  bool empty() const { return count == 0; }
  int count = 0;
};

// Of the middle 96 % of the values: what lies far outside does not stretch a picture.
Range MiddleOf(std::vector<double> values);

// At most about `count` multiples of 1, 2 or 5 times a power of ten inside the range.
std::vector<double> Ticks(const Range& range, int count);
// The tick as a number with just the decimals that `step` needs.
std::string TickLabel(double value, double step);

class Axes {
 public:
  // Grows the ranges by a margin. With equal scale the larger of the two decides and both are centred in the area.
  Axes(const Rect& area, Range x, Range y, bool equal_scale);

  Point ToPage(double x, double y) const;
  double points_per_unit() const { return scale_x_; }
  const Rect& area() const { return area_; }
  const Range& x() const { return x_; }
  const Range& y() const { return y_; }

  // Grid, frame, tick labels and axis labels.
  void Draw(Canvas& canvas, const std::string& x_label, const std::string& y_label) const;
  // A bar of a round length in metres below the frame, at its right end.
  void DrawScaleBar(Canvas& canvas) const;

 private:
  Rect area_;
  Range x_;
  Range y_;
  double scale_x_ = 1.0;
  double scale_y_ = 1.0;
};

struct LegendEntry {
  enum class Mark { kLine, kDot, kFrustum };
  std::string label;
  Color color;
  Mark mark = Mark::kLine;
  double width_pt = 2.0;
};

// One row; `right_baseline` is where it ends.
void DrawLegend(Canvas& canvas, Point right_baseline, const std::vector<LegendEntry>& entries);

}  // namespace cairn::plot

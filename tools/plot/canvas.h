// A page to draw on with cairo, written as PNG or SVG. Coordinates are in points of the page, x right, y down.
#pragma once

#include <cairo/cairo.h>

#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "base/status.h"

namespace cairn::plot {

struct Color {
  double red = 0.0;
  double green = 0.0;
  double blue = 0.0;
  double alpha = 1.0;

  Color WithAlpha(double a) const { return {red, green, blue, a}; }
};

// Okabe and Ito's colours, which stay apart under the common colour blindnesses ("Color universal design", 2008).
inline constexpr Color kBlue{0.0, 0.447, 0.698};
inline constexpr Color kVermilion{0.835, 0.369, 0.0};
inline constexpr Color kGreen{0.0, 0.620, 0.451};
inline constexpr Color kPurple{0.8, 0.475, 0.655};
inline constexpr Color kOrange{0.902, 0.624, 0.0};
inline constexpr Color kSky{0.337, 0.706, 0.914};
inline constexpr Color kInk{0.13, 0.13, 0.15};
inline constexpr Color kGray{0.55, 0.55, 0.58};
inline constexpr Color kGrid{0.90, 0.90, 0.92};

// The i-th of the colours above for categories, repeating.
Color CategoryColor(int index);

// From dark blue (0) over magenta to yellow-orange (1): even steps in lightness, readable in gray and to the
// colour-blind. After matplotlib's "plasma" (van der Walt, Smith, 2015; CC0), without its palest end.
Color Sequential(double share);

struct Point {
  double x = 0.0;
  double y = 0.0;
};

struct Rect {
  double x = 0.0;
  double y = 0.0;
  double width = 0.0;
  double height = 0.0;

  double right() const { return x + width; }
  double bottom() const { return y + height; }
};

enum class Align { kLeft, kCenter, kRight };

struct TextStyle {
  double size_pt = 11.0;
  bool bold = false;
  Color color = kInk;
  Align align = Align::kLeft;
  double angle_rad = 0.0;  // clockwise on the page
};

class Canvas {
 public:
  // `pixel_scale`: pixels per point in a PNG.
  static absl::StatusOr<Canvas> Create(const std::string& path, double width_pt, double height_pt, double pixel_scale);

  void Line(Point from, Point to, Color color, double width_pt = 1.0);
  void Polyline(const std::vector<Point>& points, Color color, double width_pt, bool dashed = false);
  void Polygon(const std::vector<Point>& points, Color fill, Color stroke, double width_pt);
  void Disc(Point center, double radius_pt, Color fill);
  void FillRect(const Rect& rect, Color fill);
  // An 8-bit grey image, stretched over the rectangle.
  void Image(const cv::Mat& gray, const Rect& rect);
  void StrokeRect(const Rect& rect, Color color, double width_pt = 1.0);
  // `at` is on the baseline.
  void Text(Point at, const std::string& text, const TextStyle& style = {});
  double TextWidth(const std::string& text, const TextStyle& style = {});
  // Everything drawn until ClearClip stays inside.
  void SetClip(const Rect& rect);
  void ClearClip();

  // Writes the file whole or not at all. AlreadyExists if there is one and not `overwrite`.
  absl::Status Finish(bool overwrite);

 private:
  struct Deleter {
    void operator()(cairo_t* context) const { cairo_destroy(context); }
    void operator()(cairo_surface_t* surface) const { cairo_surface_destroy(surface); }
  };
  void SetFont(const std::string& text, const TextStyle& style);
  void SetColor(Color color);

  std::string path_;
  bool png_ = true;
  // An SVG is written here as it is drawn; on the heap because cairo keeps its address.
  std::unique_ptr<std::string> bytes_;
  std::unique_ptr<cairo_surface_t, Deleter> surface_;
  std::unique_ptr<cairo_t, Deleter> context_;
};

}  // namespace cairn::plot

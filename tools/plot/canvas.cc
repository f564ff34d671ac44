#include "plot/canvas.h"

#include <cairo/cairo-svg.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "io/atomic_file.h"
#include "plot/fonts.h"
#include "text/text.h"

namespace cairn::plot {
namespace {

cairo_status_t Append(void* closure, const unsigned char* data, unsigned int length) {
  static_cast<std::string*>(closure)->append(reinterpret_cast<const char*>(data), length);
  return CAIRO_STATUS_SUCCESS;
}

}  // namespace

Color CategoryColor(int index) {
  static constexpr std::array<Color, 6> kColors = {kBlue, kVermilion, kGreen, kPurple, kOrange, kSky};
  return kColors[static_cast<std::size_t>(std::max(index, 0)) % kColors.size()];
}

Color Sequential(double share) {
  static constexpr std::array<Color, 7> kStops = {{{0.051, 0.031, 0.529},
                                                   {0.325, 0.008, 0.639},
                                                   {0.545, 0.039, 0.647},
                                                   {0.722, 0.196, 0.537},
                                                   {0.859, 0.361, 0.408},
                                                   {0.957, 0.533, 0.286},
                                                   {0.988, 0.706, 0.180}}};
  const double at = std::isfinite(share) ? std::clamp(share, 0.0, 1.0) * (kStops.size() - 1) : 0.0;
  const std::size_t i = std::min(static_cast<std::size_t>(at), kStops.size() - 2);
  const double t = at - static_cast<double>(i);
  const Color &a = kStops[i], &b = kStops[i + 1];
  return {a.red + t * (b.red - a.red), a.green + t * (b.green - a.green), a.blue + t * (b.blue - a.blue)};
}

absl::StatusOr<Canvas> Canvas::Create(const std::string& path, double width_pt, double height_pt, double pixel_scale) {
  Canvas canvas;
  canvas.path_ = path;
  canvas.bytes_ = std::make_unique<std::string>();
  const std::string lower = absl::AsciiStrToLower(path);
  canvas.png_ = absl::EndsWith(lower, ".png");
  if (!canvas.png_ && !absl::EndsWith(lower, ".svg")) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": pictures are written as .png or .svg"));
  }
  if (canvas.png_) {
    canvas.surface_.reset(cairo_image_surface_create(CAIRO_FORMAT_RGB24,
                                                     static_cast<int>(std::lround(width_pt * pixel_scale)),
                                                     static_cast<int>(std::lround(height_pt * pixel_scale))));
  } else {
    canvas.surface_.reset(cairo_svg_surface_create_for_stream(Append, canvas.bytes_.get(), width_pt, height_pt));
  }
  if (const cairo_status_t status = cairo_surface_status(canvas.surface_.get()); status != CAIRO_STATUS_SUCCESS) {
    return absl::ResourceExhaustedError(absl::StrCat("cannot make a picture of ", width_pt, " x ", height_pt,
                                                     " points: ", cairo_status_to_string(status)));
  }
  canvas.context_.reset(cairo_create(canvas.surface_.get()));
  cairo_t* c = canvas.context_.get();
  if (canvas.png_) cairo_scale(c, pixel_scale, pixel_scale);
  cairo_set_source_rgb(c, 1, 1, 1);
  cairo_paint(c);
  cairo_set_line_join(c, CAIRO_LINE_JOIN_ROUND);
  cairo_set_line_cap(c, CAIRO_LINE_CAP_ROUND);
  return canvas;
}

void Canvas::SetColor(Color color) {
  cairo_set_source_rgba(context_.get(), color.red, color.green, color.blue, color.alpha);
}

void Canvas::Line(Point from, Point to, Color color, double width_pt) {
  cairo_t* c = context_.get();
  SetColor(color);
  cairo_set_line_width(c, width_pt);
  cairo_move_to(c, from.x, from.y);
  cairo_line_to(c, to.x, to.y);
  cairo_stroke(c);
}

void Canvas::Polyline(const std::vector<Point>& points, Color color, double width_pt, bool dashed) {
  if (points.size() < 2) return;
  cairo_t* c = context_.get();
  SetColor(color);
  cairo_set_line_width(c, width_pt);
  const std::array<double, 2> dash = {4.0, 3.0};
  if (dashed) cairo_set_dash(c, dash.data(), 2, 0.0);
  cairo_move_to(c, points[0].x, points[0].y);
  for (std::size_t i = 1; i < points.size(); ++i) cairo_line_to(c, points[i].x, points[i].y);
  cairo_stroke(c);
  if (dashed) cairo_set_dash(c, nullptr, 0, 0.0);
}

void Canvas::Polygon(const std::vector<Point>& points, Color fill, Color stroke, double width_pt) {
  if (points.size() < 3) return;
  cairo_t* c = context_.get();
  cairo_move_to(c, points[0].x, points[0].y);
  for (std::size_t i = 1; i < points.size(); ++i) cairo_line_to(c, points[i].x, points[i].y);
  cairo_close_path(c);
  SetColor(fill);
  cairo_fill_preserve(c);
  SetColor(stroke);
  cairo_set_line_width(c, width_pt);
  cairo_stroke(c);
}

void Canvas::Disc(Point center, double radius_pt, Color fill) {
  cairo_t* c = context_.get();
  SetColor(fill);
  cairo_new_sub_path(c);
  cairo_arc(c, center.x, center.y, radius_pt, 0.0, 6.283185307179586);
  cairo_fill(c);
}

void Canvas::FillRect(const Rect& rect, Color fill) {
  SetColor(fill);
  cairo_rectangle(context_.get(), rect.x, rect.y, rect.width, rect.height);
  cairo_fill(context_.get());
}

void Canvas::Image(const cv::Mat& gray, const Rect& rect) {
  cairo_t* c = context_.get();
  const std::unique_ptr<cairo_surface_t, Deleter> surface(
      cairo_image_surface_create(CAIRO_FORMAT_RGB24, gray.cols, gray.rows));
  if (cairo_surface_status(surface.get()) != CAIRO_STATUS_SUCCESS) return;
  unsigned char* data = cairo_image_surface_get_data(surface.get());
  const int stride = cairo_image_surface_get_stride(surface.get());
  for (int y = 0; y < gray.rows; ++y) {
    auto* row = reinterpret_cast<std::uint32_t*>(data + static_cast<std::ptrdiff_t>(y) * stride);
    for (int x = 0; x < gray.cols; ++x) row[x] = gray.at<std::uint8_t>(y, x) * 0x010101u;
  }
  cairo_surface_mark_dirty(surface.get());
  cairo_save(c);
  cairo_translate(c, rect.x, rect.y);
  cairo_scale(c, rect.width / gray.cols, rect.height / gray.rows);
  cairo_set_source_surface(c, surface.get(), 0.0, 0.0);
  cairo_paint(c);
  cairo_restore(c);
}

void Canvas::StrokeRect(const Rect& rect, Color color, double width_pt) {
  SetColor(color);
  cairo_set_line_width(context_.get(), width_pt);
  cairo_rectangle(context_.get(), rect.x, rect.y, rect.width, rect.height);
  cairo_stroke(context_.get());
}

void Canvas::SetFont(const std::string& text, const TextStyle& style) {
  cairo_font_face_t* const font = FontFor(text, style.bold);
  cairo_set_font_face(context_.get(), font);
  cairo_font_face_destroy(font);
  cairo_set_font_size(context_.get(), style.size_pt);
}

double Canvas::TextWidth(const std::string& of, const TextStyle& style) {
  const std::string text = text::Shown(of);
  SetFont(text, style);
  cairo_text_extents_t extents;
  cairo_text_extents(context_.get(), text.c_str(), &extents);
  return extents.x_advance;
}

void Canvas::Text(Point at, const std::string& of, const TextStyle& style) {
  const std::string text = text::Shown(of);
  const double width = TextWidth(text, style);
  cairo_t* c = context_.get();
  cairo_save(c);
  cairo_translate(c, at.x, at.y);
  cairo_rotate(c, style.angle_rad);
  const double shift = style.align == Align::kLeft ? 0.0 : style.align == Align::kCenter ? -0.5 * width : -width;
  cairo_move_to(c, shift, 0.0);
  SetColor(style.color);
  cairo_show_text(c, text.c_str());
  cairo_restore(c);
  cairo_new_path(c);
}

void Canvas::SetClip(const Rect& rect) {
  cairo_rectangle(context_.get(), rect.x, rect.y, rect.width, rect.height);
  cairo_clip(context_.get());
}

void Canvas::ClearClip() { cairo_reset_clip(context_.get()); }

absl::Status Canvas::Finish(bool overwrite) {
  cairo_status_t status = cairo_status(context_.get());
  context_.reset();
  if (status == CAIRO_STATUS_SUCCESS) {
    if (png_) {
      status = cairo_surface_write_to_png_stream(surface_.get(), Append, bytes_.get());
    } else {
      cairo_surface_finish(surface_.get());
      status = cairo_surface_status(surface_.get());
    }
  }
  if (status != CAIRO_STATUS_SUCCESS) {
    return absl::InternalError(absl::StrCat("drawing ", path_, " failed: ", cairo_status_to_string(status)));
  }
  return io::WriteFileAtomically(path_, *bytes_, overwrite);
}

}  // namespace cairn::plot

#include "synth/materials.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>
#include <vector>

#include "base/random.h"

namespace cairn::synth {
namespace {

// A surface being painted. Lengths are in metres, tones in [0, 255].
class Painter {
 public:
  Painter(double width_m, double height_m, double texels_per_m, std::uint64_t seed)
      : random(seed),
        width(width_m),
        height(height_m),
        scale_(texels_per_m),
        image_(std::max(4, static_cast<int>(std::lround(height_m * texels_per_m))),
               std::max(4, static_cast<int>(std::lround(width_m * texels_per_m))), CV_8UC1, cv::Scalar(128)) {}

  double Tone(double low, double high) { return random.Uniform(low, high); }
  double U(double low, double high) { return random.Uniform(low, high); }

  void Fill(double tone) { image_.setTo(cv::Scalar(tone)); }

  void Box(double x, double y, double w, double h, double tone) {
    Polygon({{x, y}, {x + w, y}, {x + w, y + h}, {x, y + h}}, tone);
  }
  void Frame(double x, double y, double w, double h, double thickness, double tone) {
    Box(x, y, w, thickness, tone);
    Box(x, y + h - thickness, w, thickness, tone);
    Box(x, y, thickness, h, tone);
    Box(x + w - thickness, y, thickness, h, tone);
  }
  void Polygon(const std::vector<cv::Point2d>& corners, double tone) {
    std::vector<cv::Point> points;
    for (const cv::Point2d& c : corners) points.push_back(Fixed(c.x, c.y));
    cv::fillConvexPoly(image_, points, cv::Scalar(tone), cv::LINE_AA, kShift);
  }
  void Disc(double x, double y, double radius, double tone) {
    cv::circle(image_, Fixed(x, y), std::max(1, static_cast<int>(radius * scale_ * (1 << kShift))), cv::Scalar(tone),
               cv::FILLED, cv::LINE_AA, kShift);
  }
  void Ring(double x, double y, double radius, double thickness, double tone) {
    cv::circle(image_, Fixed(x, y), std::max(1, static_cast<int>(radius * scale_ * (1 << kShift))), cv::Scalar(tone),
               Thickness(thickness), cv::LINE_AA, kShift);
  }
  void Line(double x0, double y0, double x1, double y1, double thickness, double tone) {
    cv::line(image_, Fixed(x0, y0), Fixed(x1, y1), cv::Scalar(tone), Thickness(thickness), cv::LINE_AA, kShift);
  }
  // `size`: height of a capital letter. (x, y): the baseline's left end.
  void Text(double x, double y, double size, const std::string& text, double tone) {
    const double font_scale = size * scale_ / 21.0;
    if (font_scale < 0.1) return;
    cv::putText(image_, text, cv::Point(static_cast<int>(x * scale_), static_cast<int>(y * scale_)),
                cv::FONT_HERSHEY_DUPLEX, font_scale, cv::Scalar(tone), std::max(1, static_cast<int>(font_scale * 2.0)),
                cv::LINE_AA);
  }
  std::string Word() {
    static constexpr char kLetters[] = "ABCDEFGHIKLMNOPRSTUVWXYZabdeghknopqrstuvyz23456789";
    std::string word;
    const std::uint64_t length = 2 + random.Below(7);
    for (std::uint64_t i = 0; i < length; ++i) word += kLetters[random.Below(sizeof(kLetters) - 1)];
    return word;
  }
  // Lines of words that fill a rectangle.
  void Paragraph(double x, double y, double w, double h, double size, double tone) {
    for (double line = y + size; line < y + h; line += 1.9 * size) {
      double at = x;
      const double end = x + w * U(0.6, 1.0);
      while (at < end - 2 * size) {
        const std::string word = Word();
        const double length = 0.95 * size * static_cast<double>(word.size());
        if (at + length > x + w) break;
        Text(at, line, size, word, tone);
        at += length + size;
      }
    }
  }

  // Adds smooth random variation; `cell` is its wavelength in metres, `stretch` > 1 makes it longer along x.
  void Noise(double cell, double amplitude, double stretch = 1.0) {
    const double cell_x = std::max(cell * stretch * scale_, 1.0), cell_y = std::max(cell * scale_, 1.0);
    const int columns = static_cast<int>(image_.cols / cell_x) + 4, rows = static_cast<int>(image_.rows / cell_y) + 4;
    cv::Mat grid(rows, columns, CV_32FC1);
    for (int y = 0; y < rows; ++y) {
      for (int x = 0; x < columns; ++x) grid.at<float>(y, x) = static_cast<float>(random.Normal(0.0, amplitude));
    }
    cv::Mat large;
    cv::resize(grid, large, cv::Size(static_cast<int>(columns * cell_x) + 1, static_cast<int>(rows * cell_y) + 1), 0, 0,
               cv::INTER_CUBIC);
    const int x0 = static_cast<int>(cell_x), y0 = static_cast<int>(cell_y);
    cv::add(image_, large(cv::Rect(x0, y0, image_.cols, image_.rows)), image_, cv::noArray(), CV_8UC1);
  }
  void Fractal(double coarse, double fine, double amplitude, double stretch = 1.0) {
    for (double cell = coarse; cell >= fine; cell *= 0.5) Noise(cell, amplitude, stretch);
  }
  // Small marks: `per_m2` of them, of `size` metres.
  void Speckles(double per_m2, double size, double contrast) {
    const int count = static_cast<int>(per_m2 * width * height);
    for (int i = 0; i < count; ++i) {
      const double x = U(0, width), y = U(0, height), r = size * U(0.4, 1.3), a = U(0, 6.28);
      const double tone =
          std::clamp(At(x, y) + contrast * (random.Below(2) == 0 ? -1.0 : 1.0) * U(0.5, 1.0), 0.0, 255.0);
      if (random.Below(3) == 0) {
        Disc(x, y, 0.6 * r, tone);
      } else {
        const double c = r * std::cos(a), s = r * std::sin(a), k = U(0.3, 1.0);
        Polygon({{x + c, y + s}, {x - k * s, y + k * c}, {x - c, y - s}, {x + k * s, y - k * c}}, tone);
      }
    }
  }
  double At(double x, double y) const {
    return image_.at<std::uint8_t>(std::clamp(static_cast<int>(y * scale_), 0, image_.rows - 1),
                                   std::clamp(static_cast<int>(x * scale_), 0, image_.cols - 1));
  }
  cv::Mat& image() { return image_; }

  Random random;
  const double width;
  const double height;

 private:
  static constexpr int kShift = 4;
  cv::Point Fixed(double x, double y) const {
    // Texel (i) covers [i, i + 1) in texture coordinates, OpenCV's pixel i is centred at i.
    return {static_cast<int>(std::lround((x * scale_ - 0.5) * (1 << kShift))),
            static_cast<int>(std::lround((y * scale_ - 0.5) * (1 << kShift)))};
  }
  int Thickness(double thickness) const { return std::max(1, static_cast<int>(std::lround(thickness * scale_))); }

  const double scale_;
  cv::Mat image_;
};

void Plaster(Painter& p) {
  p.Fill(p.Tone(150, 200));
  p.Fractal(1.2, 0.02, 7.0);
  p.Speckles(45, 0.022, 55);
  const int cracks = 1 + static_cast<int>(p.width * p.height * 0.7);
  for (int i = 0; i < cracks; ++i) {
    double x = p.U(0, p.width), y = p.U(0, p.height), a = p.U(0, 6.28);
    for (int k = 0; k < 12; ++k) {
      const double x1 = x + 0.06 * std::cos(a), y1 = y + 0.06 * std::sin(a);
      p.Line(x, y, x1, y1, 0.004, 95);
      x = x1;
      y = y1;
      a += p.U(-0.8, 0.8);
    }
  }
  p.Noise(0.006, 3.0);
}

void Wallpaper(Painter& p) {
  const double ground = p.Tone(140, 200);
  p.Fill(ground);
  p.Fractal(1.0, 0.1, 5.0);
  const double pitch = p.U(0.14, 0.22);
  for (double y = 0.5 * pitch; y < p.height; y += pitch) {
    for (double x = 0.5 * pitch; x < p.width; x += pitch) {
      const double cx = x + p.U(-0.03, 0.03), cy = y + p.U(-0.03, 0.03), r = pitch * p.U(0.12, 0.32);
      const double tone = ground + (p.random.Below(2) == 0 ? -1.0 : 0.6) * p.U(35, 90);
      switch (p.random.Below(4)) {
        case 0:
          p.Disc(cx, cy, r, tone);
          break;
        case 1:
          p.Ring(cx, cy, r, 0.012, tone);
          break;
        case 2: {
          const double a = p.U(0, 1.57), c = r * std::cos(a), s = r * std::sin(a);
          p.Polygon({{cx + c, cy + s}, {cx - s, cy + c}, {cx - c, cy - s}, {cx + s, cy - c}}, tone);
          break;
        }
        default:
          p.Line(cx - r, cy + p.U(-r, r), cx + r, cy + p.U(-r, r), 0.014, tone);
      }
    }
  }
  p.Noise(0.008, 3.0);
}

void Brick(Painter& p) {
  p.Fill(p.Tone(160, 195));
  p.Noise(0.01, 8.0);
  const double w = 0.24, h = 0.075, joint = 0.011, base = p.Tone(80, 130);
  int row = 0;
  for (double y = 0; y < p.height; y += h, ++row) {
    for (double x = row % 2 == 0 ? 0.0 : -0.5 * w; x < p.width; x += w) {
      const double tone = base + p.U(-42, 42);
      p.Box(x + joint / 2 + p.U(-0.003, 0.003), y + joint / 2 + p.U(-0.002, 0.002), w - joint, h - joint, tone);
    }
  }
  p.Fractal(0.3, 0.009, 5.0);
  p.Speckles(60, 0.012, 45);
}

void Boards(Painter& p, double board, bool vertical) {
  const double across = vertical ? p.width : p.height, along = vertical ? p.height : p.width;
  const double base = p.Tone(95, 160);
  p.Fill(base);
  for (double at = 0; at < across; at += board) {
    for (double from = -p.U(0, 1.5); from < along; from += 1.8) {
      const double tone = base + p.U(-28, 28);
      if (vertical) {
        p.Box(at, from, board, 1.8, tone);
        p.Line(at, from, at + board, from, 0.004, 40);
      } else {
        p.Box(from, at, 1.8, board, tone);
        p.Line(from, at, from, at + board, 0.004, 40);
      }
    }
  }
  for (double cell = 0.05; cell > 0.004; cell *= 0.5) p.Noise(cell, 7.0, vertical ? 0.12 : 12.0);
  for (double at = 0; at < across; at += board) {
    if (vertical) {
      p.Line(at, 0, at, along, 0.005, 45);
    } else {
      p.Line(0, at, along, at, 0.005, 45);
    }
  }
  const int knots = static_cast<int>(p.width * p.height * 7);
  for (int i = 0; i < knots; ++i) {
    const double x = p.U(0, p.width), y = p.U(0, p.height), r = p.U(0.006, 0.02);
    p.Ring(x, y, 1.5 * r, 0.004, base - 30);
    p.Disc(x, y, r, base - p.U(35, 60));
  }
}

void Concrete(Painter& p) {
  p.Fill(p.Tone(115, 160));
  p.Fractal(1.5, 0.012, 6.5);
  p.Speckles(90, 0.012, 45);
  for (double x = p.U(0.3, 0.9); x < p.width; x += 1.2) p.Line(x, 0, x, p.height, 0.008, 80);
  for (double x = 0.3; x < p.width; x += 0.6) {
    for (double y = 0.3; y < p.height; y += 0.6) p.Disc(x, y, 0.013, 60);
  }
}

void Tiles(Painter& p) {
  const double tile = p.U(0.28, 0.42), base = p.Tone(110, 165);
  p.Fill(base - 55);
  for (double y = 0; y < p.height; y += tile) {
    for (double x = 0; x < p.width; x += tile) {
      p.Box(x + 0.004, y + 0.004, tile - 0.008, tile - 0.008, base + p.U(-35, 35));
      if (p.random.Below(4) == 0) {
        p.Polygon({{x + 0.5 * tile, y + 0.15 * tile},
                   {x + 0.85 * tile, y + 0.5 * tile},
                   {x + 0.5 * tile, y + 0.85 * tile},
                   {x + 0.15 * tile, y + 0.5 * tile}},
                  base + p.U(-60, 60));
      }
    }
  }
  p.Fractal(0.4, 0.01, 4.5);
  p.Speckles(70, 0.014, 50);
}

void Carpet(Painter& p) {
  const double base = p.Tone(80, 140);
  p.Fill(base);
  p.Fractal(0.8, 0.01, 7.0);
  const double border = std::min(0.12, 0.2 * std::min(p.width, p.height));
  const int shapes = static_cast<int>(p.width * p.height * 14);
  for (int i = 0; i < shapes; ++i) {
    const double x = p.U(0, p.width), y = p.U(0, p.height), r = p.U(0.03, 0.13), a = p.U(0, 6.28);
    const double c = r * std::cos(a), s = r * std::sin(a);
    p.Polygon({{x + c, y + s}, {x - 0.6 * s, y + 0.6 * c}, {x - c, y - s}, {x + 0.6 * s, y - 0.6 * c}},
              base + p.U(-60, 75));
  }
  p.Frame(0, 0, p.width, p.height, 0.3 * border, base + 70);
  p.Frame(0.5 * border, 0.5 * border, p.width - border, p.height - border, 0.15 * border, base - 45);
  p.Noise(0.006, 9.0);
}

void Ceiling(Painter& p) {
  p.Fill(p.Tone(195, 215));
  p.Fractal(1.0, 0.1, 3.0);
  for (double x = 0; x < p.width; x += 0.6) p.Line(x, 0, x, p.height, 0.014, 120);
  for (double y = 0; y < p.height; y += 0.6) p.Line(0, y, p.width, y, 0.014, 120);
  p.Speckles(110, 0.016, 70);
  for (double x = 0; x < p.width; x += 0.6) {
    for (double y = 0; y < p.height; y += 0.6) {
      if (p.random.Below(9) == 0) p.Box(x + 0.02, y + 0.02, 0.56, 0.56, 250);
      if (p.random.Below(12) == 0) p.Ring(x + 0.3, y + 0.3, 0.09, 0.02, 60);
    }
  }
}

void Poster(Painter& p) {
  const double ground = p.Tone(60, 235);
  p.Fill(ground);
  p.Fractal(0.6 * p.width, 0.05, 9.0);
  const int shapes = 7 + static_cast<int>(p.random.Below(10));
  const double unit = std::min(p.width, p.height);
  for (int i = 0; i < shapes; ++i) {
    const double x = p.U(0.05, 0.95) * p.width, y = p.U(0.05, 0.95) * p.height, r = unit * p.U(0.05, 0.28);
    const double tone = p.Tone(10, 250);
    switch (p.random.Below(5)) {
      case 0:
        p.Disc(x, y, r, tone);
        break;
      case 1:
        p.Box(x - r, y - 0.5 * r, 2 * r, r, tone);
        break;
      case 2:
        p.Polygon({{x, y - r}, {x + r * p.U(0.4, 1), y + r}, {x - r * p.U(0.4, 1), y + r * p.U(0.2, 1)}}, tone);
        break;
      case 3:
        p.Ring(x, y, r, 0.15 * r, tone);
        break;
      default:
        for (int k = 0; k < 5; ++k)
          p.Line(x - r, y + (k - 2) * 0.3 * r, x + r, y + (k - 2) * 0.3 * r + p.U(-r, r) * 0.2, 0.06 * r, tone);
    }
  }
  const double ink = ground > 128 ? 20 : 240;
  p.Text(0.08 * p.width, 0.18 * p.height, 0.1 * unit, p.Word(), ink);
  p.Text(0.08 * p.width, 0.9 * p.height, 0.06 * unit, p.Word() + " " + p.Word(), ink);
  p.Paragraph(0.1 * p.width, p.U(0.5, 0.7) * p.height, 0.5 * p.width, 0.14 * p.height, std::max(0.014, 0.022 * unit),
              ink);
  p.Noise(0.01, 4.0);
  p.Frame(0, 0, p.width, p.height, 0.025 * unit, p.Tone(15, 60));
}

void Page(Painter& p) {
  p.Fill(p.Tone(215, 240));
  p.Paragraph(0.08 * p.width, 0.06 * p.height, 0.84 * p.width, 0.5 * p.height, 0.012, 40);
  p.Box(0.1 * p.width, 0.6 * p.height, 0.5 * p.width, 0.3 * p.height, p.Tone(90, 180));
  p.Disc(0.4 * p.width, 0.75 * p.height, 0.1 * p.width, 60);
  p.Noise(0.02, 3.0);
}

void Books(Painter& p) {
  p.Fill(25);
  double x = 0.0;
  while (x < p.width) {
    const double w = p.U(0.018, 0.055), top = p.height * p.U(0.0, 0.16), tone = p.Tone(25, 235);
    p.Box(x, top, w - 0.002, p.height - top, tone);
    const double ink = tone > 128 ? p.Tone(10, 60) : p.Tone(180, 250);
    p.Box(x, top + 0.02, w - 0.002, p.U(0.006, 0.03), ink);
    if (p.random.Below(2) == 0) p.Box(x, p.height - p.U(0.03, 0.07), w - 0.002, 0.015, ink);
    for (double y = top + 0.07; y < p.height - 0.08; y += p.U(0.012, 0.03)) {
      p.Box(x + 0.2 * w, y, w * p.U(0.3, 0.55), 0.008, ink);
    }
    x += w;
  }
  p.Noise(0.01, 4.0);
}

void Cardboard(Painter& p) {
  const double base = p.Tone(110, 160);
  p.Fill(base);
  p.Fractal(0.3, 0.01, 4.0);
  p.Box(0, 0.44 * p.height, p.width, 0.09 * p.height, base + 45);
  const double lx = p.U(0.08, 0.5) * p.width, ly = p.U(0.08, 0.2) * p.height;
  p.Box(lx, ly, 0.4 * p.width, 0.28 * p.height, 235);
  p.Paragraph(lx + 0.02 * p.width, ly + 0.02 * p.height, 0.36 * p.width, 0.24 * p.height, 0.014, 30);
  p.Text(0.1 * p.width, 0.82 * p.height, 0.1 * p.height, p.Word(), 50);
  for (double x = 0.6 * p.width; x < 0.9 * p.width; x += p.U(0.005, 0.014)) {
    p.Box(x, 0.62 * p.height, p.U(0.002, 0.007), 0.13 * p.height, 25);
  }
  p.Speckles(120, 0.012, 40);
  p.Frame(0, 0, p.width, p.height, 0.006, base - 45);
}

void Screen(Painter& p) {
  p.Fill(p.Tone(20, 60));
  for (int i = 0; i < 4; ++i) {
    const double x = p.U(0.02, 0.55) * p.width, y = p.U(0.03, 0.5) * p.height;
    const double w = p.U(0.25, 0.42) * p.width, h = p.U(0.25, 0.45) * p.height, tone = p.Tone(120, 240);
    p.Box(x, y, w, h, tone);
    p.Box(x, y, w, 0.05 * p.height, p.Tone(50, 110));
    p.Paragraph(x + 0.02 * p.width, y + 0.07 * p.height, 0.9 * w, h - 0.1 * p.height, 0.010, tone > 128 ? 30 : 230);
  }
  p.Frame(0, 0, p.width, p.height, 0.015, 15);
}

void Metal(Painter& p) {
  const double base = p.Tone(120, 175);
  p.Fill(base);
  for (double cell = 0.02; cell > 0.003; cell *= 0.5) p.Noise(cell, 3.0, 15.0);
  const int drawers = std::max(1, static_cast<int>(std::lround(p.height / 0.28)));
  const double h = p.height / drawers;
  for (int i = 0; i < drawers; ++i) {
    const double y = i * h;
    p.Frame(0.01, y + 0.008, p.width - 0.02, h - 0.016, 0.006, base - 60);
    p.Box(0.36 * p.width, y + 0.55 * h, 0.28 * p.width, 0.022, 45);
    p.Box(0.33 * p.width, y + 0.18 * h, 0.34 * p.width, 0.05, 230);
    p.Text(0.35 * p.width, y + 0.18 * h + 0.04, 0.026, p.Word(), 30);
    if (p.random.Below(2) == 0) {
      const double s = p.U(0.03, 0.07), x = p.U(0.05, 0.25) * p.width, top = y + p.U(0.1, 0.5) * h;
      p.Box(x, top, 1.4 * s, s, p.Tone(20, 250));
      p.Disc(x + 0.7 * s, top + 0.5 * s, 0.3 * s, p.Tone(20, 250));
    }
  }
  p.Speckles(40, 0.01, 50);
}

void Fabric(Painter& p) {
  const double base = p.Tone(50, 150), pitch = p.U(0.05, 0.11);
  p.Fill(base);
  for (double x = 0; x < p.width; x += pitch) p.Box(x, 0, p.U(0.2, 0.5) * pitch, p.height, base + p.U(-25, 45));
  for (double y = 0; y < p.height; y += pitch) p.Box(0, y, p.width, p.U(0.1, 0.3) * pitch, base + p.U(-35, 60));
  p.Fractal(0.2, 0.008, 6.0);
}

void Door(Painter& p) {
  Boards(p, 0.32, true);
  p.Frame(0, 0, p.width, p.height, 0.05, 70);
  p.Frame(0.15 * p.width, 0.08 * p.height, 0.7 * p.width, 0.36 * p.height, 0.015, 60);
  p.Frame(0.15 * p.width, 0.52 * p.height, 0.7 * p.width, 0.38 * p.height, 0.015, 60);
  p.Disc(0.9 * p.width, 0.5 * p.height, 0.03, 235);
  p.Box(0.3 * p.width, 0.2 * p.height, 0.4 * p.width, 0.12, 235);
  p.Text(0.34 * p.width, 0.2 * p.height + 0.085, 0.05, p.Word(), 20);
}

void Window(Painter& p) {
  p.Fill(225);
  p.Fractal(0.8, 0.1, 8.0);
  double x = 0.0;
  while (x < p.width) {  // a skyline
    const double w = p.U(0.06, 0.22), h = p.U(0.2, 0.6) * p.height, tone = p.Tone(80, 190);
    p.Box(x, p.height - h, w, h, tone);
    for (double y = p.height - h + 0.03; y < p.height; y += 0.045) {
      for (double u = x + 0.015; u < x + w - 0.02; u += 0.035) p.Box(u, y, 0.016, 0.022, tone - p.U(10, 60));
    }
    x += w;
  }
  p.Frame(0, 0, p.width, p.height, 0.05, 240);
  p.Box(0.5 * p.width - 0.02, 0, 0.04, p.height, 240);
  p.Box(0, 0.4 * p.height, p.width, 0.035, 240);
}

// Parallel stripes of unequal width with soft edges. Straight edges stay straight in an image: of a circle of pixels
// around any place on them at most half is on one side, at every scale, which is no corner. Towards the border of the
// surface they fade, so that there is none where surfaces meet.
void Stripes(Painter& p) {
  constexpr double kEdge = 0.06;  // width of an edge
  constexpr double kFade = 0.8, kGround = 130.0;
  const auto smooth = [](double share) { return share * share * (3.0 - 2.0 * share); };
  const double angle = (p.random.Below(2) == 0 ? -1.0 : 1.0) * p.U(0.45, 1.1);
  const double across_x = std::cos(angle), across_y = std::sin(angle);
  const double reach = p.width + p.height;
  std::vector<std::pair<double, double>> stripes;  // where each begins, and its tone
  bool dark = p.random.Below(2) == 0;
  for (double at = -reach; at < reach; at += p.U(0.3, 0.55), dark = !dark) {
    stripes.emplace_back(at, dark ? p.Tone(75, 105) : p.Tone(155, 185));
  }
  cv::Mat& image = p.image();
  const double texel_x = p.width / image.cols, texel_y = p.height / image.rows;
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const double px = (x + 0.5) * texel_x, py = (y + 0.5) * texel_y, at = px * across_x + py * across_y;
      const auto next = std::upper_bound(stripes.begin() + 1, stripes.end() - 1, at,
                                         [](double value, const auto& stripe) { return value < stripe.first; });
      const double tone = (next - 1)->second, into = std::clamp((at - (next - 1)->first) / kEdge, 0.0, 1.0);
      const double before = next - 1 == stripes.begin() ? tone : (next - 2)->second;
      const double fade = smooth(std::min(1.0, std::min({px, py, p.width - px, p.height - py}) / kFade));
      const double value = kGround + fade * (before + smooth(into) * (tone - before) - kGround);
      image.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(std::lround(value));
    }
  }
}

}  // namespace

cv::Mat MakeMaterial(Material material, double width_m, double height_m, double texels_per_m, std::uint64_t seed) {
  Painter p(width_m, height_m, texels_per_m, seed);
  switch (material) {
    case Material::kBlank:
      p.Fill(p.Tone(165, 205));
      p.Noise(1.5, 2.5);
      break;
    case Material::kPlaster:
      Plaster(p);
      break;
    case Material::kWallpaper:
      Wallpaper(p);
      break;
    case Material::kBrick:
      Brick(p);
      break;
    case Material::kPaneling:
      Boards(p, 0.14, true);
      break;
    case Material::kConcrete:
      Concrete(p);
      break;
    case Material::kWood:
      Boards(p, 0.12, false);
      break;
    case Material::kTiles:
      Tiles(p);
      break;
    case Material::kCarpet:
      Carpet(p);
      break;
    case Material::kCeiling:
      Ceiling(p);
      break;
    case Material::kPoster:
      Poster(p);
      break;
    case Material::kPage:
      Page(p);
      break;
    case Material::kBooks:
      Books(p);
      break;
    case Material::kCardboard:
      Cardboard(p);
      break;
    case Material::kScreen:
      Screen(p);
      break;
    case Material::kMetal:
      Metal(p);
      break;
    case Material::kFabric:
      Fabric(p);
      break;
    case Material::kDoor:
      Door(p);
      break;
    case Material::kWindow:
      Window(p);
      break;
    case Material::kStripes:
      Stripes(p);
      break;
  }
  return p.image();
}

}  // namespace cairn::synth

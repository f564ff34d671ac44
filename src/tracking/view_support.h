// How much of a view shows what a pose says that it should: matches that agree on a pose prove little where they are
// few of those that the map lets expect there, or in one part of the image only.
#pragma once

#include <array>
#include <cstddef>

#include "geometry/pinhole.h"

namespace cairn::tracking {

// The image in cells.
class ViewSupport {
 public:
  static constexpr int kCellsPerSide = 8;

  explicit ViewSupport(const Pinhole& pinhole) : width_px_(pinhole.width_px), height_px_(pinhole.height_px) {}

  void Expect(const Eigen::Vector2d& pixel) { ++expected_[Cell(pixel)]; }  // a point of the map should be seen here
  void Find(const Eigen::Vector2d& pixel) { ++found_[Cell(pixel)]; }       // and one was

  // Cells where at least three points should be seen (a single one may be hidden), and those of them that show one.
  int visible_cells() const;
  int cells() const;
  // The share of the one in the other, less two standard deviations of so small a sample; 0 if there are none.
  double Share() const { return ShareOf(cells(), visible_cells()); }
  static double ShareOf(int cells, int visible_cells);

 private:
  std::size_t Cell(const Eigen::Vector2d& pixel) const;

  int width_px_, height_px_;
  std::array<int, kCellsPerSide * kCellsPerSide> expected_{}, found_{};
};

}  // namespace cairn::tracking

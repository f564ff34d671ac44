#include "tracking/view_support.h"

#include <algorithm>
#include <cmath>

namespace cairn::tracking {
namespace {

constexpr int kExpectedPoints = 3;

}  // namespace

std::size_t ViewSupport::Cell(const Eigen::Vector2d& pixel) const {
  const auto part = [](double x, int size) {
    return static_cast<std::size_t>(std::clamp(static_cast<int>(x * kCellsPerSide / size), 0, kCellsPerSide - 1));
  };
  return part(pixel.y(), height_px_) * kCellsPerSide + part(pixel.x(), width_px_);
}

int ViewSupport::visible_cells() const {
  return static_cast<int>(std::ranges::count_if(expected_, [](int count) { return count >= kExpectedPoints; }));
}

int ViewSupport::cells() const {
  int cells = 0;
  for (std::size_t i = 0; i < found_.size(); ++i) cells += expected_[i] >= kExpectedPoints && found_[i] > 0 ? 1 : 0;
  return cells;
}

double ViewSupport::ShareOf(int cells, int visible_cells) {
  if (visible_cells == 0) return 0.0;
  const double share = static_cast<double>(cells) / visible_cells;
  return share - 2.0 * std::sqrt(share * (1.0 - share) / visible_cells);
}

}  // namespace cairn::tracking

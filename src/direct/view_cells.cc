#include "direct/view_cells.h"

#include <algorithm>

namespace cairn::direct {

std::size_t CellOf(const Pinhole& camera, double x_px, double y_px) {
  const int column = std::clamp(static_cast<int>(x_px * kCellColumns / camera.width_px), 0, kCellColumns - 1);
  const int row = std::clamp(static_cast<int>(y_px * kCellRows / camera.height_px), 0, kCellRows - 1);
  return static_cast<std::size_t>(row * kCellColumns + column);
}

CellSet LargeRegions(const CellSet& set) {
  CellSet large = {}, visited = {};
  std::array<int, kCellColumns * kCellRows> region;
  for (int seed = 0; seed < kCellColumns * kCellRows; ++seed) {
    if (!set[static_cast<std::size_t>(seed)] || visited[static_cast<std::size_t>(seed)]) continue;
    int count = 0;
    const auto visit = [&](int x, int y) {
      if (x < 0 || y < 0 || x >= kCellColumns || y >= kCellRows) return;
      const auto at = static_cast<std::size_t>(y * kCellColumns + x);
      if (!set[at] || visited[at]) return;
      visited[at] = true;
      region[static_cast<std::size_t>(count++)] = y * kCellColumns + x;
    };
    visit(seed % kCellColumns, seed / kCellColumns);
    for (int i = 0; i < count; ++i) {
      const int x = region[static_cast<std::size_t>(i)] % kCellColumns,
                y = region[static_cast<std::size_t>(i)] / kCellColumns;
      visit(x - 1, y), visit(x + 1, y), visit(x, y - 1), visit(x, y + 1);
    }
    for (int i = 0; i < count && count >= kMinRegionCells; ++i) {
      large[static_cast<std::size_t>(region[static_cast<std::size_t>(i)])] = true;
    }
  }
  return large;
}

}  // namespace cairn::direct

// Keeps points apart: answers whether a pixel has a neighbour within a radius.
#pragma once

#include <algorithm>
#include <vector>

namespace cairn::direct {

class SpacingGrid {
 public:
  static constexpr int kCellPx = 8;

  void Reset(int width_px, int height_px) {
    cells_x_ = width_px / kCellPx + 1;
    cells_y_ = height_px / kCellPx + 1;
    head_.assign(static_cast<std::size_t>(cells_x_) * cells_y_, -1);
    entries_.clear();
  }
  void Add(float x, float y) {
    int& head = head_[Cell(x, y)];
    entries_.push_back({x, y, head});
    head = static_cast<int>(entries_.size()) - 1;
  }
  bool HasNeighbour(float x, float y, float radius_px) const {
    const int x0 = Clamp(x - radius_px, cells_x_), x1 = Clamp(x + radius_px, cells_x_);
    const int y0 = Clamp(y - radius_px, cells_y_), y1 = Clamp(y + radius_px, cells_y_);
    for (int cy = y0; cy <= y1; ++cy) {
      for (int cx = x0; cx <= x1; ++cx) {
        for (int i = head_[static_cast<std::size_t>(cy) * cells_x_ + cx]; i >= 0; i = entries_[i].next) {
          const float dx = entries_[i].x - x, dy = entries_[i].y - y;
          if (dx * dx + dy * dy < radius_px * radius_px) return true;
        }
      }
    }
    return false;
  }

 private:
  struct Entry {
    float x, y;
    int next;
  };
  static int Clamp(float at, int cells) { return std::clamp(static_cast<int>(at) / kCellPx, 0, cells - 1); }
  std::size_t Cell(float x, float y) const {
    return static_cast<std::size_t>(Clamp(y, cells_y_)) * cells_x_ + Clamp(x, cells_x_);
  }

  int cells_x_ = 0;
  int cells_y_ = 0;
  std::vector<int> head_;
  std::vector<Entry> entries_;
};

}  // namespace cairn::direct

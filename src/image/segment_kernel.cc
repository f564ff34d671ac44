#include "image/segment_kernel.h"

#include <algorithm>

namespace cairn::image::internal {

std::size_t NearSegmentPortable(const GridEntry* entries, std::size_t count, const SegmentQuery& query,
                                std::uint32_t* out) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const GridEntry& entry = entries[i];
    const double px = entry.x_px - query.begin_x, py = entry.y_px - query.begin_y;
    const double along = std::min(std::max((px * query.dx + py * query.dy) * query.inverse_squared, 0.0), 1.0);
    const double ex = px - along * query.dx, ey = py - along * query.dy;
    // Without a branch, which would be guessed wrongly every other time.
    out[kept] = entry.index;
    kept += static_cast<std::size_t>(ex * ex + ey * ey <= query.half_width_squared) &
            static_cast<std::size_t>(entry.octave - query.low_octave <= query.octaves);
  }
  return kept;
}

}  // namespace cairn::image::internal

// The view in cells, to tell an obstacle before a part of it from misfits here and there.
#pragma once

#include <array>
#include <cstddef>

#include "geometry/pinhole.h"

namespace cairn::direct {

inline constexpr int kCellColumns = 8;
inline constexpr int kCellRows = 6;
inline constexpr int kMinRegionCells = 5;  // side by side: an obstacle, not a misfit
using CellSet = std::array<bool, static_cast<std::size_t>(kCellColumns) * kCellRows>;

// The cell of a pixel of an image of that camera; of one outside, the nearest.
std::size_t CellOf(const Pinhole& camera, double x_px, double y_px);

// The cells of `set` that lie in regions, connected by their sides, of at least kMinRegionCells.
CellSet LargeRegions(const CellSet& set);

}  // namespace cairn::direct

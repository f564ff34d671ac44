// Where the tests of a coverage were made: which of them share a frame, how the ground lies there, and its cells.
#pragma once

#include <vector>

#include "inspect/coverage.h"

namespace cairn::inspect {

// As Coverage::grounds. `cell_size`: as of CoverageOptions.
std::vector<CoverageGround> GroundsOf(const map::Snapshot& map, const std::vector<CoverageTest>& tests,
                                      double cell_size);

}  // namespace cairn::inspect

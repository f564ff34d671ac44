// How many findings are told of a map file.
#pragma once

#include <cstddef>

namespace cairn::store {

// A file that is damaged all over is not described any better by a longer list: looking ends with so many.
inline constexpr std::size_t kMaxFindings = 1000;

}  // namespace cairn::store

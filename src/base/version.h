// The software's version, as stored in every map and printed by `cairn --version`.
#pragma once

namespace cairn {

inline constexpr const char* kVersion = "0.1.0";

}  // namespace cairn

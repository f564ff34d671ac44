// What the files of COLMAP's sparse models have in common, for who writes and who reads them (colmap.h).
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

namespace cairn::exchange::colmap {

static_assert(std::endian::native == std::endian::little, "the format is written in the machine's order");

inline constexpr double kPixelCentre = 0.5;
inline constexpr std::int64_t kNoPoint = -1;
inline constexpr std::uint64_t kNoPointBinary = ~std::uint64_t{0};

// COLMAP's models that are known here: the number in binary files, the name in text files, and the parameters.
struct ModelSpec {
  int number;
  const char* name;
  std::size_t parameters;
};
inline constexpr ModelSpec kModels[] = {{0, "SIMPLE_PINHOLE", 3}, {1, "PINHOLE", 4}, {2, "SIMPLE_RADIAL", 4},
                                        {3, "RADIAL", 5},         {4, "OPENCV", 8},  {5, "OPENCV_FISHEYE", 8}};

}  // namespace cairn::exchange::colmap

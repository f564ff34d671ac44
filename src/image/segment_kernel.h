// The inner loop of FeatureGrid::QuerySegment: of a run of keypoints, those near a line segment.
#pragma once

#include <cstddef>
#include <cstdint>

namespace cairn::image::internal {

struct GridEntry {
  float x_px;
  float y_px;
  std::uint32_t index;
  std::uint32_t octave;
};

struct SegmentQuery {
  double begin_x, begin_y;
  double dx, dy;                 // to the end
  double inverse_squared;        // of its length; 0: a point
  double half_width_squared;     // within which a keypoint is near
  std::uint32_t low_octave = 0;  // the lowest wanted ...
  std::uint32_t octaves = 0;     // ... and how many more
};

inline constexpr std::size_t kSegmentSlack = 4;

// Writes the indices of the near ones of entries[0 .. count - 1] in their order and returns how many they are. `out`
// has room for count + kSegmentSlack. All give the same answer, to the bit.
using SegmentKernel = std::size_t (*)(const GridEntry* entries, std::size_t count, const SegmentQuery& query,
                                      std::uint32_t* out);
std::size_t NearSegmentPortable(const GridEntry* entries, std::size_t count, const SegmentQuery& query,
                                std::uint32_t* out);
std::size_t NearSegmentAvx2(const GridEntry* entries, std::size_t count, const SegmentQuery& query, std::uint32_t* out);

}  // namespace cairn::image::internal

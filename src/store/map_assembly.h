// Puts the rows of a map file together to what a map is made of: what rows leave out, because it follows from others,
// is added, and every reference is checked.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <unordered_map>
#include <vector>

#include "base/status.h"
#include "map/delta.h"
#include "store/map_store.h"
#include "store/tables.h"

namespace cairn::store {

// Told of everything wrong. An error that it returns ends the reading; with OK the row at fault is left out.
using FindingSink = std::function<absl::Status(const Finding&)>;

// Rows of points by id.
class PointIndex {
 public:
  static constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();

  explicit PointIndex(const std::vector<PointRow>& points);
  std::size_t Find(PointId id) const;  // kNone: there is none

 private:
  std::vector<std::uint32_t> dense_;                 // by id, row + 1; empty if the ids are scattered
  std::unordered_map<PointId, std::size_t> sparse_;  // then these
};

// What a point takes from the features of its reference keyframe.
struct PointAnchor {
  image::Descriptor descriptor{};
  std::uint8_t octave = 0;
};

// All tables of a map file but the vocabulary and the log of changes.
struct MapRows {
  std::int64_t format = 0;
  MapRow map_row;
  map::Delta content;  // cameras, sessions and components, ascending
  // Ascending, with features and the points they observe; without neighbours and children.
  std::vector<std::shared_ptr<map::Keyframe>> keyframes;
  std::vector<PointRow> points;      // ascending
  std::vector<PointAnchor> anchors;  // per point, if the features of keyframes are on demand; else empty
  std::vector<EdgeRow> edges;

  map::Keyframe* FindKeyframe(std::int64_t id);  // null: none
};

// The neighbours of a keyframe in their order.
void SortCovisible(map::Keyframe* keyframe);

// All of the map as the one change that leads from nothing to its revision.
absl::StatusOr<map::Delta> AssembleMap(MapRows rows, const FindingSink& sink);

}  // namespace cairn::store

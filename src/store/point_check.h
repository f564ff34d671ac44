// Whether the points of a map are good, with all that observe them, for `verify`: a range of ids at a time, each by
// itself, so that two connections can share the ranges.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/status.h"
#include "map/entities.h"
#include "store/checked_keyframe.h"
#include "store/map_assembly.h"
#include "store/sqlite.h"

namespace cairn::store {

// Of which map, and in which parts: the same for all who check it.
struct PointRanges {
  PointId end;                    // above every id
  std::uint32_t ids_per_range{};  // whole pages of ready points
  bool ready = false;             // what is ready to be queried is of this revision: its points are compared

  static PointRanges Of(PointId end);
  std::uint32_t size() const { return (end.value() + ids_per_range - 1) / ids_per_range; }
  std::uint32_t RangeOf(PointId point) const { return point.value() / ids_per_range; }
};

class PointCheck {
 public:
  // Within a read transaction; `keyframes` ascending.
  PointCheck(Database* database, const PointRanges& ranges, std::span<const CheckedKeyframe> keyframes);

  // False, and the rest of the range is left, as soon as the row of one is not good by itself.
  absl::StatusOr<bool> Check(std::uint32_t range, const FindingSink& sink);
  // Rows in all ranges that were checked.
  std::int64_t num_points() const { return num_points_; }

 private:
  absl::Status Report(absl::string_view table, std::int64_t id, absl::string_view message);
  absl::StatusOr<bool> ReadRange();
  absl::Status TakeObservations(const CheckedKeyframe& known);
  absl::Status CheckReadyPages();

  Database* database_;
  const PointRanges ranges_;
  const std::span<const CheckedKeyframe> keyframes_;
  const FindingSink* sink_ = nullptr;
  ObservedPoints observed_points_;
  std::int64_t num_points_ = 0;
  std::int64_t num_findings_ = 0;
  std::uint64_t first_ = 0, end_ = 0;    // ids of the range
  std::vector<map::MapPoint> in_range_;  // kept, for their room
  std::size_t num_in_range_ = 0;         // of these
  std::vector<ComponentId> component_;   // of these: from where they are seen
  std::vector<std::uint32_t> place_;     // by id from the first of the range on: there, + 1; 0: none
};

}  // namespace cairn::store

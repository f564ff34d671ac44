// What `verify` keeps of each keyframe while the rows of a map go by, and what it reads of it again.
#pragma once

#include <bitset>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "base/status.h"
#include "store/ready_pages.h"
#include "store/sqlite.h"

namespace cairn::store {

// Points are looked at in so many ranges of ids at most; of each keyframe it is kept in which it observes some.
inline constexpr std::size_t kMostPointRanges = 256;

struct CheckedKeyframe {
  ReadyKeyframe head;
  KeyframeId parent;
  bool has_features = false, has_points = false;
  std::bitset<kMostPointRanges> ranges;  // in which it observes points
};

// Of ascending ids; null if there is none.
const CheckedKeyframe* FindKeyframe(std::span<const CheckedKeyframe> keyframes, std::int64_t id);

// Which points a keyframe observes, feature for feature.
class ObservedPoints {
 public:
  explicit ObservedPoints(Database* database) : database_(database) {}
  absl::StatusOr<std::vector<PointId>> Of(const CheckedKeyframe& keyframe);

 private:
  Database* database_;
  std::optional<Statement> rows_;
};

}  // namespace cairn::store

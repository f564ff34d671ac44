// What `verify` keeps of each keyframe while the rows of a map go by, and what it reads of it again.
#pragma once

#include <algorithm>
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
  bool has_features = false;
  std::bitset<kMostPointRanges> ranges;  // in which it observes points
};

// Of ascending ids; null if there is none. `Keyframe`: CheckedKeyframe, const or not.
template <class Keyframe>
Keyframe* FindKeyframe(std::span<Keyframe> keyframes, std::int64_t id) {
  const auto at = std::ranges::lower_bound(
      keyframes, id, {}, [](const CheckedKeyframe& known) { return static_cast<std::int64_t>(known.head.id.value()); });
  return at == keyframes.end() || static_cast<std::int64_t>(at->head.id.value()) != id ? nullptr : &*at;
}

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

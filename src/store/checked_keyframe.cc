#include "store/checked_keyframe.h"

#include <algorithm>

#include "store/map_reader.h"

namespace cairn::store {

const CheckedKeyframe* FindKeyframe(std::span<const CheckedKeyframe> keyframes, std::int64_t id) {
  const auto at = std::lower_bound(keyframes.begin(), keyframes.end(), id, [](const auto& known, std::int64_t key) {
    return static_cast<std::int64_t>(known.head.id.value()) < key;
  });
  return at == keyframes.end() || static_cast<std::int64_t>(at->head.id.value()) != id ? nullptr : &*at;
}

absl::StatusOr<std::vector<PointId>> ObservedPoints::Of(const CheckedKeyframe& keyframe) {
  if (!rows_) {
    CAIRN_ASSIGN_OR_RETURN(rows_, database_->Prepare(kKeyframePointsTable.SelectSql("WHERE keyframe = ?")));
  }
  rows_->Bind(1, static_cast<std::int64_t>(keyframe.head.id.value()));
  CAIRN_ASSIGN_OR_RETURN(const bool found, rows_->Step());
  if (!found) return absl::DataLossError("a row is gone");
  auto points = PointIdsFromRow(*rows_, keyframe.head.num_features);
  rows_->Reset();
  return points;
}

}  // namespace cairn::store

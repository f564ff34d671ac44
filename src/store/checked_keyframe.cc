#include "store/checked_keyframe.h"

#include "store/map_reader.h"

namespace cairn::store {

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

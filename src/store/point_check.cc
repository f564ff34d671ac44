#include "store/point_check.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "store/fault.h"
#include "store/ready_check.h"
#include "store/row.h"
#include "store/tables.h"

namespace cairn::store {
namespace {

constexpr std::uint32_t kFewestIdsPerRange = 1 << 15;

}  // namespace

PointRanges PointRanges::Of(PointId end) {
  const std::uint64_t per_range = end.value() / kMostPointRanges + 1;
  const std::uint64_t whole_pages = (per_range + kPointsPerPage - 1) / kPointsPerPage * kPointsPerPage;
  return {.end = end,
          .ids_per_range = static_cast<std::uint32_t>(std::max<std::uint64_t>(whole_pages, kFewestIdsPerRange))};
}

PointCheck::PointCheck(Database* database, const PointRanges& ranges, std::span<const CheckedKeyframe> keyframes)
    : database_(database), ranges_(ranges), keyframes_(keyframes), observed_points_(database) {}

absl::Status PointCheck::Report(absl::string_view table, std::int64_t id, absl::string_view message) {
  ++num_findings_;
  return (*sink_)(Finding{std::string(table), id, std::string(message)});
}

absl::StatusOr<bool> PointCheck::Check(std::uint32_t range, const FindingSink& sink) {
  sink_ = &sink;
  first_ = std::uint64_t{range} * ranges_.ids_per_range;
  end_ = first_ + ranges_.ids_per_range;
  const std::int64_t found_before = num_findings_;
  CAIRN_ASSIGN_OR_RETURN(const bool good, ReadRange());
  if (!good) return false;
  num_points_ += static_cast<std::int64_t>(num_in_range_);
  for (const CheckedKeyframe& known : keyframes_) {
    if (known.ranges.test(range)) CAIRN_RETURN_IF_ERROR(TakeObservations(known));
  }
  for (std::size_t i = 0; i < num_in_range_; ++i) {
    map::MapPoint& point = in_range_[i];
    const auto reference = std::ranges::find(point.observations, point.reference.keyframe, &map::Observation::keyframe);
    if (reference != point.observations.end()) {
      point.reference = *reference;
    } else {
      CAIRN_RETURN_IF_ERROR(Report("points", point.id.value(), "the reference keyframe does not observe the point"));
    }
  }
  if (ranges_.ready && num_findings_ == found_before) CAIRN_RETURN_IF_ERROR(CheckReadyPages());
  return true;
}

absl::StatusOr<bool> PointCheck::ReadRange() {
  place_.assign(ranges_.ids_per_range, 0);
  component_.resize(ranges_.ids_per_range);
  num_in_range_ = 0;
  CAIRN_ASSIGN_OR_RETURN(Statement rows,
                         database_->Prepare(kPointsTable.SelectSql("WHERE id >= ? AND id < ? ORDER BY id")));
  rows.Bind(1, static_cast<std::int64_t>(first_));
  rows.Bind(2, static_cast<std::int64_t>(end_));
  Row row;
  while (true) {
    const absl::StatusOr<bool> found = rows.Step();
    if (IsDamaged(found.status())) return false;
    CAIRN_RETURN_IF_ERROR(found.status());
    if (!*found) return true;
    PointRow value;
    if (!ReadChecked(rows, &row, &value).ok() || !value.position.allFinite()) return false;
    if (num_in_range_ == in_range_.size()) in_range_.emplace_back();
    map::MapPoint& point = in_range_[num_in_range_++];
    SetFromRow(value, &point);
    point.observations.clear();
    component_[num_in_range_ - 1] = ComponentId();
    place_[value.id.value() - first_] = static_cast<std::uint32_t>(num_in_range_);
  }
}

absl::Status PointCheck::TakeObservations(const CheckedKeyframe& known) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<PointId> points, observed_points_.Of(known));
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    if (!points[i] || points[i].value() < first_ || points[i].value() >= end_) continue;
    const std::uint32_t place = place_[points[i].value() - first_];
    map::MapPoint* point = place == 0 ? nullptr : &in_range_[place - 1];
    const bool twice =
        point != nullptr && !point->observations.empty() && point->observations.back().keyframe == known.head.id;
    if (point == nullptr || twice) {
      CAIRN_RETURN_IF_ERROR(
          Report("keyframe_points", known.head.id.value(),
                 absl::StrCat("point ", points[i].value(), twice ? " is there twice" : " is missing")));
      continue;
    }
    if (!point->observations.empty() && component_[place - 1] != known.head.component) {
      CAIRN_RETURN_IF_ERROR(Report("points", point->id.value(), "it is seen from two components"));
    }
    component_[place - 1] = known.head.component;
    point->observations.push_back({known.head.id, i});
  }
  return absl::OkStatus();
}

absl::Status PointCheck::CheckReadyPages() {
  std::vector<const map::MapPoint*> of_page;
  for (std::size_t i = 0; i < num_in_range_;) {
    const std::uint32_t page = in_range_[i].id.value() / kPointsPerPage;
    of_page.clear();
    for (; i < num_in_range_ && in_range_[i].id.value() / kPointsPerPage == page; ++i) of_page.push_back(&in_range_[i]);
    CAIRN_RETURN_IF_ERROR(CheckReadyPage(database_, *sink_, ReadyKind::kPoints, page, PackReadyPoints(of_page)));
  }
  return absl::OkStatus();
}

}  // namespace cairn::store

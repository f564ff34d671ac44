#include "api/map_alignment.h"

#include <algorithm>
#include <cmath>

namespace cairn::api {
namespace {

absl::Status Check(const ReferencePoses& reference) {
  if (reference.poses.empty()) return absl::InvalidArgumentError("align: the reference has no poses");
  return Annotate(reference.solver.Validate(), "align");
}

absl::Status Check(const GeoPositions& reference) {
  constexpr std::size_t kMinPositions = 3;
  if (reference.positions.size() < kMinPositions) {
    return absl::InvalidArgumentError(absl::StrCat(
        "align: ", kMinPositions, " geographic positions at least are needed, there are ", reference.positions.size()));
  }
  for (const GeoPositions::At& at : reference.positions)
    CAIRN_RETURN_IF_ERROR(Annotate(at.position.Validate(), "align"));
  return absl::OkStatus();
}

absl::Status Check(const map::GeoAnchor& anchor) { return Annotate(anchor.Validate(), "align"); }
absl::Status Check(const NoGeoAnchor&) { return absl::OkStatus(); }
absl::Status Check(const KnownPlaces& known) { return known.Validate(); }

}  // namespace

absl::Status AlignRequest::Validate() const {
  if (!(max_dt_s >= 0.0) || !std::isfinite(max_dt_s)) {
    return absl::InvalidArgumentError("align: max_dt_s must be a number of seconds");
  }
  return std::visit([](const auto& reference) { return Check(reference); }, by);
}

}  // namespace cairn::api

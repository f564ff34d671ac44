// What is told of a stored map on the wire: as wire/convert.h.
#pragma once

#include <cairn/v1/admin.pb.h>

#include "base/status.h"
#include "map/overview.h"

namespace cairn::wire {

void ToProto(const map::MapOverview& overview, v1::OverviewMapResponse* out);
absl::StatusOr<map::MapOverview> FromProto(const v1::OverviewMapResponse& message);

}  // namespace cairn::wire

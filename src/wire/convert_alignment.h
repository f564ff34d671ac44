// Alignments and places on the earth on the wire: as wire/convert.h.
#pragma once

#include <cairn/v1/align.pb.h>

#include "api/map_alignment.h"
#include "base/status.h"

namespace cairn::wire {

void ToProto(const GeoPosition& position, v1::GeoPosition* out);
void ToProto(const map::GeoAnchor& anchor, v1::GeoAnchor* out);
// Without the map's name.
void ToProto(const api::AlignRequest& request, v1::AlignMapRequest* out);
void ToProto(const api::AlignAnswer& answer, v1::AlignMapResponse* out);

absl::StatusOr<GeoPosition> FromProto(const v1::GeoPosition& message);
absl::StatusOr<map::GeoAnchor> FromProto(const v1::GeoAnchor& message);
absl::StatusOr<api::AlignRequest> FromProto(const v1::AlignMapRequest& message);
absl::StatusOr<api::AlignAnswer> FromProto(const v1::AlignMapResponse& message);

}  // namespace cairn::wire

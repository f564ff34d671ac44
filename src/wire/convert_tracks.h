// Answers of trackers on the wire: as wire/convert.h.
#pragma once

#include <cairn/v1/track.pb.h>

#include "api/tracker.h"
#include "base/status.h"

namespace cairn::wire {

void ToProto(const api::TrackAnswer& answer, v1::TrackAnswer* out);
// The error in it if the frame could not be used.
absl::StatusOr<api::TrackAnswer> FromProto(const v1::TrackAnswer& message);

}  // namespace cairn::wire

// Sessions on the wire: as wire/convert.h.
#pragma once

#include <cairn/v1/sessions.pb.h>

#include "api/map_session.h"
#include "base/status.h"

namespace cairn::wire {

void ToProto(const api::SessionRequest& request, v1::StartSession* out);
void ToProto(const api::SessionAnswer& answer, v1::FrameAnswer* out);
void ToProto(const api::SessionProgress& progress, v1::SessionProgress* out);
void ToProto(const api::SessionSummary& summary, v1::SessionSummary* out);

// InvalidArgument also without a policy.
absl::StatusOr<api::SessionRequest> FromProto(const v1::StartSession& message);
// The error in it if the frame could not be used.
absl::StatusOr<api::SessionAnswer> FromProto(const v1::FrameAnswer& message);
api::SessionProgress FromProto(const v1::SessionProgress& message);
absl::StatusOr<api::SessionSummary> FromProto(const v1::SessionSummary& message);

}  // namespace cairn::wire

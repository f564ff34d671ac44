// What those who keep maps ask and are told, on the wire: as wire/convert.h.
#pragma once

#include <cairn/v1/admin.pb.h>

#include "api/map_admin.h"
#include "api/map_service.h"
#include "base/status.h"

namespace cairn::wire {

void ToProto(const api::DeletedMap& map, v1::DeletedMap* out);
void ToProto(const api::MapVerification& verified, v1::VerifyMapResponse* out);
void ToProto(const api::MapLog& log, v1::ReadLogResponse* out);
void ToProto(const api::SessionRemoval& removal, v1::RemoveSessionResponse* out);
v1::ExportMapRequest::Content Write(api::ExportContent content);

api::DeletedMap FromProto(const v1::DeletedMap& message);
absl::StatusOr<api::MapVerification> FromProto(const v1::VerifyMapResponse& message);
// InvalidArgument for a count that is negative; more than there are is all of them.
absl::StatusOr<map::ChangeQuery> FromProto(const v1::ReadLogRequest& message);
api::SessionRemoval FromProto(const v1::RemoveSessionResponse& message);
api::MapLog FromProto(const v1::ReadLogResponse& message);
absl::StatusOr<api::ExportContent> Read(v1::ExportMapRequest::Content content);

}  // namespace cairn::wire

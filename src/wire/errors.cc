#include "wire/errors.h"

#include <cairn/v1/types.pb.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "absl/strings/numbers.h"

namespace cairn::wire {
namespace {

using Code = absl::StatusCode;
using store::Fault;

constexpr absl::string_view kRetryPayload = "cairn.wire.RetryAfter";

constexpr std::array<ErrorKind, 28> kKinds = {{
    {"ok", Code::kOk, 200},
    {"cancelled", Code::kCancelled, 499},
    {"unknown", Code::kUnknown, 500},
    {"invalid_argument", Code::kInvalidArgument, 400},
    {"deadline_exceeded", Code::kDeadlineExceeded, 504},
    {"not_found", Code::kNotFound, 404},
    {"already_exists", Code::kAlreadyExists, 409},
    {"permission_denied", Code::kPermissionDenied, 403},
    {"resource_exhausted", Code::kResourceExhausted, 429},
    {"failed_precondition", Code::kFailedPrecondition, 409},
    {"aborted", Code::kAborted, 409},
    {"out_of_range", Code::kOutOfRange, 400},
    {"unimplemented", Code::kUnimplemented, 501},
    {"internal", Code::kInternal, 500},
    {"unavailable", Code::kUnavailable, 503},
    {"data_loss", Code::kDataLoss, 500},
    {"unauthenticated", Code::kUnauthenticated, 401},
    {"map_not_found", Code::kNotFound, 404, Fault::kNotFound},
    {"map_exists", Code::kAlreadyExists, 409, Fault::kExists},
    {"map_not_a_map", Code::kInvalidArgument, 409, Fault::kNotAMap},
    {"map_damaged", Code::kDataLoss, 500, Fault::kDamaged},
    {"map_newer_version", Code::kUnimplemented, 501, Fault::kNewerVersion},
    {"map_busy", Code::kUnavailable, 503, Fault::kBusy},
    {"disk_full", Code::kResourceExhausted, 507, Fault::kFull},
    {"map_read_only", Code::kPermissionDenied, 403, Fault::kReadOnly},
    {"map_foreign_log", Code::kFailedPrecondition, 409, Fault::kForeignLog},
    {"map_moved", Code::kAborted, 409, Fault::kMoved},
    {"map_io", Code::kInternal, 500, Fault::kIo},
}};

template <class Fits>
const ErrorKind* Find(Fits fits) {
  const auto found = std::find_if(kKinds.begin(), kKinds.end(), fits);
  return found == kKinds.end() ? nullptr : &*found;
}

const ErrorKind& KindOfCode(Code code) {
  const ErrorKind* kind = Find([&](const ErrorKind& k) { return k.code == code && k.fault == Fault::kNone; });
  return kind != nullptr ? *kind : KindOfCode(Code::kUnknown);
}

}  // namespace

std::span<const ErrorKind> ErrorKinds() { return kKinds; }

const ErrorKind& KindOf(const absl::Status& status) {
  const Fault fault = store::FaultOf(status);
  if (fault == Fault::kNone) return KindOfCode(status.code());
  const ErrorKind* kind = Find([&](const ErrorKind& k) { return k.fault == fault; });
  return kind != nullptr ? *kind : KindOfCode(status.code());
}

absl::Status RetryLater(absl::string_view message, double retry_after_s) {
  absl::Status status = absl::ResourceExhaustedError(message);
  if (retry_after_s > 0.0) status.SetPayload(kRetryPayload, absl::Cord(absl::StrCat(retry_after_s)));
  return status;
}

double RetryAfterOf(const absl::Status& status) {
  const absl::optional<absl::Cord> payload = status.GetPayload(kRetryPayload);
  double seconds = 0.0;
  if (!payload || !absl::SimpleAtod(std::string(*payload), &seconds) || !std::isfinite(seconds)) return 0.0;
  return std::max(0.0, seconds);
}

std::string DetailsOf(const absl::Status& status, absl::string_view request_id) {
  v1::ErrorDetail detail;
  detail.set_reason(std::string(KindOf(status).reason));
  detail.set_request_id(std::string(request_id));
  detail.set_retry_after_s(RetryAfterOf(status));
  return detail.SerializeAsString();
}

absl::Status StatusFrom(int code, absl::string_view message, const std::string& details) {
  v1::ErrorDetail detail;
  if (code != 0 && !details.empty() && detail.ParseFromString(details)) {
    const ErrorKind* kind = Find([&](const ErrorKind& k) { return k.reason == detail.reason(); });
    if (kind != nullptr && kind->fault != Fault::kNone) return store::MakeFault(kind->fault, message);
    if (code == static_cast<int>(Code::kResourceExhausted)) return RetryLater(message, detail.retry_after_s());
  }
  return {KindOfCode(static_cast<Code>(code)).code, message};
}

absl::Status StatusOfReason(absl::string_view reason, absl::string_view message) {
  if (reason.empty()) return absl::OkStatus();
  const ErrorKind* kind = Find([&](const ErrorKind& k) { return k.reason == reason; });
  if (kind == nullptr || kind->code == Code::kOk) return absl::UnknownError(message);
  return kind->fault != Fault::kNone ? store::MakeFault(kind->fault, message) : absl::Status(kind->code, message);
}

}  // namespace cairn::wire

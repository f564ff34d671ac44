// The one table of what goes wrong: for each kind of error its gRPC code, its HTTP status, and a reason that programs
// and metrics tell apart. docs/server.md shows it.
#pragma once

#include <span>
#include <string>

#include "absl/strings/string_view.h"
#include "base/status.h"
#include "store/fault.h"

namespace cairn::wire {

struct ErrorKind {
  absl::string_view reason;  // in answers, and the label in metrics
  absl::StatusCode code;     // gRPC's has the same number
  int http_status = 0;
  store::Fault fault = store::Fault::kNone;  // of the map that it is about
};

// All of them, the OK one first.
std::span<const ErrorKind> ErrorKinds();

// By its fault if it has one, else by its code.
const ErrorKind& KindOf(const absl::Status& status);

// ResourceExhausted: it may be tried again after `retry_after_s`.
absl::Status RetryLater(absl::string_view message, double retry_after_s);
// Seconds; 0: the status does not say.
double RetryAfterOf(const absl::Status& status);

// The details that go with a status: a serialized cairn.v1.ErrorDetail.
std::string DetailsOf(const absl::Status& status, absl::string_view request_id);

// The status that was sent, as far as the two know the same reasons: with its fault. `code` as gRPC has it; one that
// does not exist is Unknown.
absl::Status StatusFrom(int code, absl::string_view message, const std::string& details);

// The same of an error that is told inside an answer; OK without a reason.
absl::Status StatusOfReason(absl::string_view reason, absl::string_view message);

}  // namespace cairn::wire

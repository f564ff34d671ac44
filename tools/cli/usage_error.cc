#include "cli/usage_error.h"

#include "absl/strings/cord.h"
#include "cli/outputs.h"

namespace cairn::cli {

absl::Status UsageError(const std::string& message) {
  absl::Status status = absl::InvalidArgumentError(message);
  status.SetPayload(kUsageMark, absl::Cord());
  return status;
}

}  // namespace cairn::cli

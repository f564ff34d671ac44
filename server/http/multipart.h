// Forms with files in them, as browsers and `curl -F` send them: multipart/form-data (RFC 7578).
#pragma once

#include <vector>

#include "absl/strings/string_view.h"
#include "base/status.h"

namespace cairn::server {

struct FormPart {
  absl::string_view name;
  absl::string_view content;
};

// The parts, in order; they point into `body`. InvalidArgument for what is no such form, or has more than 32 parts.
absl::StatusOr<std::vector<FormPart>> ParseForm(absl::string_view content_type, absl::string_view body);

}  // namespace cairn::server

// What tells a mistake in a call from other errors (UsageError in outputs.h): the verb ends as for a wrong option.
#pragma once

#include "absl/strings/string_view.h"

namespace cairn::cli {

// Of the payload of such a status.
inline constexpr absl::string_view kUsageMark = "cairn/usage";

}  // namespace cairn::cli

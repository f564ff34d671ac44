// What clients of a server are told: without the name of the directory that it serves, which is nobody's business.
#pragma once

#include <string>

#include "absl/strings/string_view.h"
#include "base/status.h"

namespace cairn::host {

std::string WithoutDirectory(absl::string_view message, const std::string& directory);
// Payloads stay.
absl::Status WithoutDirectory(const absl::Status& status, const std::string& directory);

}  // namespace cairn::host

// What clients of a server are told: without the name of the directory that it serves, which is nobody's business.
#pragma once

#include <string>

#include "absl/strings/string_view.h"
#include "base/status.h"

namespace cairn {

// What lies in it keeps its name; the directory itself is "the folder of the maps".
std::string WithoutDirectory(absl::string_view message, const std::string& directory);
// Payloads stay.
absl::Status WithoutDirectory(const absl::Status& status, const std::string& directory);

}  // namespace cairn

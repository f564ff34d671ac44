// Texts that people wrote, for messages: protobuf refuses a whole message for one byte that is no UTF-8, and names of
// folders and robots may be in any encoding.
#pragma once

#include <string>

#include "absl/strings/string_view.h"

namespace cairn::wire {

// As it is, or with U+FFFD in place of what is no UTF-8.
std::string Utf8(absl::string_view text);

}  // namespace cairn::wire

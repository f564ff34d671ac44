// What others chose (names, reasons, file names, what they sent), safe to be quoted in messages, logs and on terminals.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>

#include "absl/strings/string_view.h"

namespace cairn {

// One character of UTF-8 at the start of `text`; `bytes` is 0 for what is none.
struct Utf8Character {
  std::uint32_t code = 0;
  std::size_t bytes = 0;
};
Utf8Character FirstCharacter(absl::string_view text);

// Control characters, what turns the direction of writing, and bytes that are no UTF-8 as \xNN. Of more than
// `max_bytes` as many characters as fit in those, and "...".
std::string Shown(absl::string_view text, std::size_t max_bytes = std::numeric_limits<std::size_t>::max());

}  // namespace cairn

#include "base/shown.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

namespace cairn {
namespace {

// Of ASCII, of Latin 1 beyond it, and what turns the direction of writing.
bool Commands(std::uint32_t code) {
  return code < 0x20 || (code >= 0x7F && code <= 0x9F) || (code >= 0x202A && code <= 0x202E) ||
         (code >= 0x2066 && code <= 0x2069);
}

}  // namespace

Utf8Character FirstCharacter(absl::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<std::uint8_t>(text[i]); };
  if (text.empty()) return {};
  if (byte(0) < 0x80) return {byte(0), 1};
  const std::size_t length = byte(0) >= 0xF0 ? 4 : byte(0) >= 0xE0 ? 3 : 2;
  if (byte(0) < 0xC2 || byte(0) > 0xF4 || text.size() < length) return {};
  std::uint32_t code = byte(0) & (0x7Fu >> length);
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return {};
    code = code << 6 | (byte(i) & 0x3Fu);
  }
  constexpr std::uint32_t kSmallest[] = {0, 0, 0x80, 0x800, 0x10000};
  if (code < kSmallest[length] || code > 0x10FFFF || (code >= 0xD800 && code <= 0xDFFF)) return {};
  return {code, length};
}

std::string Shown(absl::string_view text, std::size_t max_bytes) {
  std::string shown;
  std::size_t left = max_bytes;
  while (!text.empty()) {
    const Utf8Character next = FirstCharacter(text);
    const std::size_t bytes = std::max<std::size_t>(1, next.bytes);
    if (bytes > left) return absl::StrCat(shown, "...");
    left -= bytes;
    if (next.bytes == 0 || Commands(next.code)) {
      for (const char c : text.substr(0, bytes)) {
        absl::StrAppend(&shown, "\\x", absl::Hex(static_cast<unsigned char>(c), absl::kZeroPad2));
      }
    } else {
      absl::StrAppend(&shown, text.substr(0, bytes));
    }
    text.remove_prefix(bytes);
  }
  return shown;
}

}  // namespace cairn

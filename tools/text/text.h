// Text for people: columns that line up, lines that fit a terminal of 80 columns, names that cannot command it.
#pragma once

#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace cairn::text {

inline constexpr int kTextColumns = 80;

// What others chose (names, reasons, file names), safe to be printed: control characters, and bytes that are no UTF-8,
// as \xNN.
std::string Shown(absl::string_view text);

// "1 keyframe", "12 keyframes": of what is made plural by an s.
std::string Counted(std::int64_t count, absl::string_view what);
inline std::string Keyframes(std::int64_t count) { return Counted(count, "keyframe"); }
inline std::string Points(std::int64_t count) { return Counted(count, "point"); }

// How many columns of a terminal a text takes: East Asian wide characters take two, combining ones none.
int DisplayWidth(absl::string_view text);
// At most so many columns, with "..." at the end if something was cut off.
std::string Cut(absl::string_view text, int columns);

// Lines of at most kTextColumns, broken between words, the first after `indent`, the others after `next_indent`.
std::string Wrapped(absl::string_view text, absl::string_view indent, absl::string_view next_indent);
// Likewise what does not fit, if `stream` is a terminal; elsewhere, where a program may read it, one line whatever its
// length.
std::string WrappedOn(std::FILE* stream, absl::string_view text, absl::string_view indent = "",
                      absl::string_view next_indent = "  ");

// Lines of an answer to standard output, each as by WrappedOn(), with the blanks that it begins with as its indent.
void Say(absl::string_view lines);

struct TextColumn {
  std::string name;
  bool left = false;  // texts; numbers stand at the right
};

// A line of names, then the rows, two blanks between columns. If that is wider than kTextColumns, the widest text
// column is cut. Texts are passed through Shown().
std::string TextTable(const std::vector<TextColumn>& columns, const std::vector<std::vector<std::string>>& rows,
                      absl::string_view indent = "");

}  // namespace cairn::text

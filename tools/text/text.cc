#include "text/text.h"

#include <unistd.h>

#include <algorithm>
#include <cstdint>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "base/shown.h"

namespace cairn::text {
namespace {

constexpr int kMinTextWidth = 6;  // to which a column is cut

// Unicode's "East Asian Wide" and "Fullwidth" (UAX 11), by their large blocks.
int WidthOf(std::uint32_t code) {
  if ((code >= 0x300 && code <= 0x36F) || (code >= 0x200B && code <= 0x200F) || code == 0xFEFF) return 0;
  const bool wide = (code >= 0x1100 && code <= 0x115F) || (code >= 0x2E80 && code <= 0xA4CF) ||
                    (code >= 0xAC00 && code <= 0xD7A3) || (code >= 0xF900 && code <= 0xFAFF) ||
                    (code >= 0xFE30 && code <= 0xFE6F) || (code >= 0xFF00 && code <= 0xFF60) ||
                    (code >= 0xFFE0 && code <= 0xFFE6) || (code >= 0x1F300 && code <= 0x1F9FF) ||
                    (code >= 0x20000 && code <= 0x3FFFD);
  return wide ? 2 : 1;
}

void Fill(std::string* line, int columns) { line->append(static_cast<std::size_t>(std::max(0, columns)), ' '); }

}  // namespace

std::string Shown(absl::string_view text) { return cairn::Shown(text); }

std::string Counted(std::int64_t count, absl::string_view what) {
  return absl::StrCat(count, " ", what, count == 1 ? "" : "s");
}

int DisplayWidth(absl::string_view text) {
  int columns = 0;
  while (!text.empty()) {
    const Utf8Character next = FirstCharacter(text);
    columns += next.bytes == 0 ? 1 : WidthOf(next.code);
    text.remove_prefix(std::max<std::size_t>(1, next.bytes));
  }
  return columns;
}

std::string Cut(absl::string_view text, int columns) {
  if (DisplayWidth(text) <= columns) return std::string(text);
  std::string cut;
  int used = 0;
  while (!text.empty()) {
    const Utf8Character next = FirstCharacter(text);
    const int width = next.bytes == 0 ? 1 : WidthOf(next.code);
    if (used + width > std::max(0, columns - 3)) break;
    absl::StrAppend(&cut, text.substr(0, std::max<std::size_t>(1, next.bytes)));
    used += width;
    text.remove_prefix(std::max<std::size_t>(1, next.bytes));
  }
  return absl::StrCat(cut, "...");
}

std::string Wrapped(absl::string_view text, absl::string_view indent, absl::string_view next_indent) {
  std::string all, line(indent);
  bool empty = true;
  for (const absl::string_view word : absl::StrSplit(text, ' ', absl::SkipEmpty())) {
    if (!empty && DisplayWidth(line) + 1 + DisplayWidth(word) > kTextColumns) {
      absl::StrAppend(&all, line, "\n");
      line = std::string(next_indent);
      empty = true;
    }
    absl::StrAppend(&line, empty ? "" : " ", word);
    empty = false;
  }
  return absl::StrCat(all, line, "\n");
}

std::string WrappedOn(std::FILE* stream, absl::string_view text, absl::string_view indent,
                      absl::string_view next_indent) {
  const bool fits = DisplayWidth(indent) + DisplayWidth(text) <= kTextColumns;
  if (fits || isatty(fileno(stream)) == 0) return absl::StrCat(indent, text, "\n");
  return Wrapped(text, indent, next_indent);
}

void Say(absl::string_view lines) {
  if (!lines.empty() && lines.back() == '\n') lines.remove_suffix(1);
  for (const absl::string_view line : absl::StrSplit(lines, '\n')) {
    const std::string indent(std::min(line.find_first_not_of(' '), line.size()), ' ');
    std::fputs(WrappedOn(stdout, line.substr(indent.size()), indent, absl::StrCat(indent, "  ")).c_str(), stdout);
  }
}

std::string TextTable(const std::vector<TextColumn>& columns, const std::vector<std::vector<std::string>>& rows,
                      absl::string_view indent) {
  std::vector<std::vector<std::string>> cells;
  std::vector<int> widths;
  for (const TextColumn& column : columns) widths.push_back(DisplayWidth(column.name));
  for (const std::vector<std::string>& row : rows) {
    std::vector<std::string>& shown = cells.emplace_back();
    for (std::size_t i = 0; i < columns.size(); ++i) {
      shown.push_back(Shown(row[i]));
      widths[i] = std::max(widths[i], DisplayWidth(shown[i]));
    }
  }
  const auto width_with = [&](int gap) {
    int total = static_cast<int>(indent.size()) + gap * static_cast<int>(columns.size() - 1);
    for (const int width : widths) total += width;
    return total;
  };
  const int gap = width_with(2) <= kTextColumns ? 2 : 1;
  while (width_with(gap) > kTextColumns) {
    std::size_t widest = columns.size();
    for (std::size_t i = 0; i < columns.size(); ++i) {
      if (columns[i].left && (widest == columns.size() || widths[i] > widths[widest])) widest = i;
    }
    if (widest == columns.size() || widths[widest] <= kMinTextWidth) break;
    --widths[widest];
  }
  const auto line_of = [&](const auto& text_of) {
    std::string line(indent);
    for (std::size_t i = 0; i < columns.size(); ++i) {
      const std::string text = Cut(text_of(i), widths[i]);
      const int space = widths[i] - DisplayWidth(text);
      if (i > 0) Fill(&line, gap);
      if (!columns[i].left) Fill(&line, space);
      line += text;
      if (columns[i].left) Fill(&line, space);
    }
    while (!line.empty() && line.back() == ' ') line.pop_back();
    return absl::StrCat(line, "\n");
  };
  std::string table = line_of([&](std::size_t i) { return columns[i].name; });
  for (const auto& row : cells) table += line_of([&](std::size_t i) { return row[i]; });
  return table;
}

}  // namespace cairn::text

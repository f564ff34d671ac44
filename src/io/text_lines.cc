#include "io/text_lines.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "base/frame_times.h"
#include "io/atomic_file.h"
#include "io/time_text.h"

namespace cairn::io {

namespace {

// All lines with something in them, comments too.
absl::StatusOr<std::vector<TextLine>> ReadLines(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const std::string contents, ReadWholeFile(path));
  absl::string_view rest = contents;
  absl::ConsumePrefix(&rest, "\xEF\xBB\xBF");
  std::vector<TextLine> lines;
  int number = 0;
  for (const absl::string_view raw : absl::StrSplit(rest, '\n')) {
    ++number;
    const absl::string_view text = absl::StripAsciiWhitespace(raw);
    if (!text.empty()) lines.push_back({number, std::string(text)});
  }
  return lines;
}

bool IsComment(const TextLine& line) { return line.text[0] == '#' || line.text[0] == '%'; }

bool HasNumber(absl::string_view text) {
  double ignored;
  for (const absl::string_view field : SplitFields(text)) {
    if (absl::SimpleAtod(field, &ignored)) return true;
  }
  return false;
}

// Several names of columns, none of which could be one of a file.
bool IsHeader(absl::string_view text) {
  if (HasNumber(text) || SplitFields(text).size() < 2) return false;
  for (const absl::string_view of_files : {"/", "\\", ".png", ".jp", ".pgm", ".tif", ".bmp", ".webp"}) {
    if (absl::StrContains(text, of_files)) return false;
  }
  return true;
}

}  // namespace

absl::StatusOr<std::vector<TextLine>> ReadDataLines(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(std::vector<TextLine> lines, ReadLines(path));
  std::erase_if(lines, [](const TextLine& line) { return line.text[0] == '#'; });
  return lines;
}

absl::StatusOr<TextTable> ReadTable(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(std::vector<TextLine> lines, ReadLines(path));
  TextTable table;
  for (TextLine& line : lines) {
    const bool comment = IsComment(line);
    if (table.lines.empty() && comment) table.header = line.text.substr(1);
    if (!comment) table.lines.push_back(std::move(line));
  }
  if (table.lines.size() > 1 && IsHeader(table.lines[0].text) && HasNumber(table.lines[1].text)) {
    table.header = table.lines[0].text;
    table.lines.erase(table.lines.begin());
  }
  return table;
}

std::vector<absl::string_view> SplitFields(absl::string_view text) {
  const absl::string_view separators = absl::StrContains(text, ';') ? " \t;" : " \t,";
  std::vector<absl::string_view> fields;
  std::size_t at = 0;
  while ((at = text.find_first_not_of(separators, at)) != absl::string_view::npos) {
    const bool quoted = text[at] == '"' || text[at] == '\'';
    std::size_t end = quoted ? text.find(text[at], at + 1) : text.find_first_of(separators, at);
    if (quoted && end == absl::string_view::npos) end = text.find_first_of(separators, at);
    end = std::min(end, text.size());
    const bool closed = quoted && end < text.size() && text[end] == text[at];
    fields.push_back(closed ? text.substr(at + 1, end - at - 1) : text.substr(at, end - at));
    at = closed ? end + 1 : end;
  }
  if (fields.empty()) fields.emplace_back("");
  return fields;
}

std::vector<std::string> ColumnNames(absl::string_view header) {
  const std::string lower = absl::AsciiStrToLower(absl::StripAsciiWhitespace(absl::StripPrefix(header, "#")));
  absl::string_view text = lower;
  if (const std::size_t colon = text.find(": "); colon != absl::string_view::npos) text = text.substr(0, colon);
  std::vector<std::string> names;
  const char* separators = absl::StrContains(text, ';') ? ";" : absl::StrContains(text, ',') ? "," : " \t";
  for (absl::string_view part : absl::StrSplit(text, absl::ByAnyChar(separators))) {
    part = absl::StripAsciiWhitespace(part);
    absl::ConsumePrefix(&part, "\"");
    absl::ConsumeSuffix(&part, "\"");
    const bool unit = !part.empty() && (part[0] == '[' || part[0] == '(');
    if (unit && !names.empty() && separators[0] == ' ') {
      absl::StrAppend(&names.back(), " ", part);
    } else if (!part.empty() || separators[0] != ' ') {
      names.emplace_back(part);
    }
  }
  return names;
}

bool HasDecimalCommas(absl::string_view text) {
  bool in_numbers = false, blanks = false;
  for (std::size_t i = 1; i + 1 < text.size(); ++i) {
    const auto digit = [&](std::size_t at) { return absl::ascii_isdigit(static_cast<unsigned char>(text[at])); };
    in_numbers |= text[i] == ',' && digit(i - 1) && digit(i + 1);
    blanks |= absl::ascii_isblank(static_cast<unsigned char>(text[i])) && digit(i - 1);
  }
  return in_numbers && blanks && !absl::StrContains(text, ';');
}

absl::Status CheckNoMoreFields(const std::string& path, const TextLine& line, std::size_t fields, std::size_t most,
                               absl::string_view what, absl::string_view header) {
  if (fields <= most || ColumnNames(header).size() == fields) return absl::OkStatus();
  const bool commas = absl::StrContains(line.text, ',') && !absl::StrContains(line.text, ';');
  return LineError(path, line.number,
                   absl::StrCat(fields, " columns, and `", what, "` are ", most,
                                commas ? ": a comma separates columns, the decimal sign is a point" : "",
                                "; further columns need a header that names them all"));
}

absl::Status LineError(const std::string& path, int number, absl::string_view message) {
  return absl::InvalidArgumentError(absl::StrCat(path, ":", number, ": ", message));
}

absl::Status TimeOrder::Add(TimeNs time_ns, const std::string& path, int line) {
  if (time_ns > kMaxTimeNs || time_ns < -kMaxTimeNs) {
    return LineError(path, line,
                     absl::StrCat("time ", FormatSeconds(time_ns), " s is out of range; is the unit right?"));
  }
  if (any_ && time_ns <= last_ns_) {
    return LineError(path, line,
                     absl::StrCat("time ", FormatSeconds(time_ns), " s is not after the one before, ",
                                  FormatSeconds(last_ns_), " s; sort the list and remove repeated lines"));
  }
  any_ = true;
  last_ns_ = time_ns;
  return absl::OkStatus();
}

std::string InOneLine(absl::string_view text) {
  std::string line(text);
  for (char& c : line) {
    if (absl::ascii_iscntrl(static_cast<unsigned char>(c))) c = ' ';
  }
  return line;
}

}  // namespace cairn::io

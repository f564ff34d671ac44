#include "io/text_lines.h"

#include "absl/strings/ascii.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "base/frame_times.h"
#include "io/atomic_file.h"
#include "io/time_text.h"

namespace cairn::io {

absl::StatusOr<std::vector<TextLine>> ReadDataLines(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const std::string contents, ReadWholeFile(path));
  absl::string_view rest = contents;
  absl::ConsumePrefix(&rest, "\xEF\xBB\xBF");
  std::vector<TextLine> lines;
  int number = 0;
  for (const absl::string_view raw : absl::StrSplit(rest, '\n')) {
    ++number;
    const absl::string_view text = absl::StripAsciiWhitespace(raw);
    if (text.empty() || text[0] == '#') continue;
    lines.push_back({number, std::string(text)});
  }
  return lines;
}

std::vector<absl::string_view> SplitFields(absl::string_view text) {
  std::vector<absl::string_view> fields = absl::StrSplit(text, absl::ByAnyChar(" \t,"), absl::SkipEmpty());
  if (fields.empty()) fields.emplace_back("");
  return fields;
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

}  // namespace cairn::io

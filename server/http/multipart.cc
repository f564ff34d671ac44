#include "server/http/multipart.h"

#include <algorithm>
#include <string>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "base/shown.h"

namespace cairn::server {
namespace {

constexpr std::size_t kMaxParts = 32;

absl::Status BadForm(absl::string_view what) { return absl::InvalidArgumentError(absl::StrCat("form: ", what)); }

// The value of `name` among the parameters behind the first ';' of a header; empty if it is not there.
std::string Parameter(absl::string_view header, absl::string_view name) {
  const std::vector<absl::string_view> parts = absl::StrSplit(header, ';');
  for (std::size_t i = 1; i < parts.size(); ++i) {
    const absl::string_view part = absl::StripAsciiWhitespace(parts[i]);
    const std::size_t equals = part.find('=');
    if (equals == absl::string_view::npos || !absl::EqualsIgnoreCase(part.substr(0, equals), name)) continue;
    absl::string_view value = part.substr(equals + 1);
    if (value.size() >= 2 && value.front() == '"' && value.back() == '"') value = value.substr(1, value.size() - 2);
    return std::string(value);
  }
  return "";
}

// A name of a field, as its content disposition has it; points into `headers`.
absl::StatusOr<absl::string_view> NameOf(absl::string_view headers) {
  for (const absl::string_view line : absl::StrSplit(headers, "\r\n")) {
    const std::size_t colon = line.find(':');
    if (colon == absl::string_view::npos || !absl::EqualsIgnoreCase(line.substr(0, colon), "content-disposition")) {
      continue;
    }
    const std::string name = Parameter(line.substr(colon + 1), "name");
    const std::size_t at = name.empty() ? absl::string_view::npos : line.find(name, line.find("name="));
    if (at != absl::string_view::npos) return line.substr(at, name.size());
  }
  return BadForm("a part has no name");
}

}  // namespace

absl::StatusOr<std::vector<FormPart>> ParseForm(absl::string_view content_type, absl::string_view body) {
  if (!absl::StartsWithIgnoreCase(content_type, "multipart/form-data")) {
    return BadForm("the content type must be multipart/form-data, as of curl -F");
  }
  const std::string boundary = Parameter(content_type, "boundary");
  if (boundary.empty() || boundary.size() > 70) return BadForm("the content type names no boundary");
  const std::string delimiter = absl::StrCat("--", boundary), between = absl::StrCat("\r\n", delimiter);
  if (!absl::StartsWith(body, delimiter)) return BadForm("it does not begin with its boundary");
  std::vector<FormPart> parts;
  std::size_t at = delimiter.size();
  while (!absl::StartsWith(body.substr(at), "--")) {
    if (!absl::StartsWith(body.substr(at), "\r\n")) return BadForm("a boundary does not end its line");
    const std::size_t begin = at + 2;
    const std::size_t empty_line = body.find("\r\n\r\n", begin);
    const std::size_t end = body.find(between, begin);
    if (empty_line == absl::string_view::npos || end == absl::string_view::npos || empty_line + 4 > end) {
      return BadForm("a part is cut");
    }
    if (parts.size() == kMaxParts) return BadForm("it has too many parts");
    CAIRN_ASSIGN_OR_RETURN(const absl::string_view name, NameOf(body.substr(begin, empty_line - begin)));
    // Which of them is meant, nobody can know.
    if (std::ranges::find(parts, name, &FormPart::name) != parts.end()) {
      return BadForm(absl::StrCat("it has more than one \"", Shown(name, 40), "\""));
    }
    parts.push_back({name, body.substr(empty_line + 4, end - empty_line - 4)});
    at = end + between.size();
  }
  return parts;
}

}  // namespace cairn::server

#include "api/map_service.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "base/shown.h"

namespace cairn::api {

absl::Status CheckMapName(const std::string& name) {
  constexpr std::size_t kMaxLength = 128;
  const auto allowed = [](unsigned char c) { return absl::ascii_isalnum(c) || c == '.' || c == '_' || c == '-'; };
  if (!name.empty() && name.size() <= kMaxLength && absl::ascii_isalnum(static_cast<unsigned char>(name[0])) &&
      std::all_of(name.begin(), name.end(), allowed)) {
    if (!absl::EndsWith(name, ".cairn")) return absl::OkStatus();
    return absl::InvalidArgumentError(absl::StrCat("\"", name, "\" is the name of a file: its map is called \"",
                                                   absl::StripSuffix(name, ".cairn"), "\""));
  }
  constexpr std::size_t kMaxShown = 40;
  return absl::InvalidArgumentError(
      absl::StrCat("\"", Shown(name, kMaxShown),
                   "\" is no name of a map: that takes letters (a to z), digits, '.', '_' and '-', 1 to 128 of them, a "
                   "letter or a digit first"));
}

}  // namespace cairn::api

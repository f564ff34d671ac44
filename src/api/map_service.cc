#include "api/map_service.h"

#include <algorithm>

#include "absl/strings/ascii.h"

namespace cairn::api {

absl::Status CheckMapName(const std::string& name) {
  constexpr std::size_t kMaxLength = 128;
  const auto allowed = [](unsigned char c) { return absl::ascii_isalnum(c) || c == '.' || c == '_' || c == '-'; };
  if (!name.empty() && name.size() <= kMaxLength && absl::ascii_isalnum(static_cast<unsigned char>(name[0])) &&
      std::all_of(name.begin(), name.end(), allowed)) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(
      "this is no name of a map: it takes letters, digits, '.', '_' and '-', 1 to 128 of them, a letter or a digit "
      "first");
}

}  // namespace cairn::api

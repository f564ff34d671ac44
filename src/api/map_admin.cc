#include "api/map_admin.h"

#include "absl/strings/numbers.h"
#include "api/map_service.h"

namespace cairn::api {

absl::StatusOr<DeletedName> ParseDeletedName(const std::string& deleted) {
  constexpr auto kDigits = "0123456789";
  constexpr std::int64_t kMaxMs = 9'000'000'000'000;  // in nanoseconds, it still is one number
  const std::size_t dot = deleted.rfind('.');
  DeletedName name;
  if (dot == std::string::npos || deleted.find_first_not_of(kDigits, dot + 1) != std::string::npos ||
      !absl::SimpleAtoi(deleted.substr(dot + 1), &name.deleted_ms) || name.deleted_ms > kMaxMs) {
    return absl::InvalidArgumentError("this is no name of a deleted map: it is that which deleting it answered");
  }
  name.map = deleted.substr(0, dot);
  CAIRN_RETURN_IF_ERROR(CheckMapName(name.map));
  return name;
}

}  // namespace cairn::api

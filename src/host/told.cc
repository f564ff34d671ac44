#include "host/told.h"

#include "absl/strings/str_replace.h"

namespace cairn::host {

std::string WithoutDirectory(absl::string_view message, const std::string& directory) {
  return absl::StrReplaceAll(message, {{directory + "/", ""}});
}

absl::Status WithoutDirectory(const absl::Status& status, const std::string& directory) {
  if (status.ok()) return status;
  absl::Status told(status.code(), WithoutDirectory(status.message(), directory));
  status.ForEachPayload([&](absl::string_view url, const absl::Cord& payload) { told.SetPayload(url, payload); });
  return told;
}

}  // namespace cairn::host

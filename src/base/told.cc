#include "base/told.h"

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace cairn {
namespace {

// Whether a name that begins like the directory's goes on here.
bool GoesOn(absl::string_view rest) {
  return !rest.empty() && (absl::ascii_isalnum(static_cast<unsigned char>(rest[0])) || rest[0] == '_' ||
                           rest[0] == '-' || static_cast<unsigned char>(rest[0]) >= 0x80);
}

}  // namespace

std::string WithoutDirectory(absl::string_view message, const std::string& directory) {
  std::string told;
  while (!directory.empty() && directory != "/") {
    const std::size_t at = message.find(directory);
    if (at == absl::string_view::npos) break;
    absl::StrAppend(&told, message.substr(0, at));
    message.remove_prefix(at + directory.size());
    if (GoesOn(message)) {
      told.append(directory);
    } else if (absl::StartsWith(message, "/")) {
      message.remove_prefix(1);
    } else {
      told.append("the folder of the maps");
    }
  }
  absl::StrAppend(&told, message);
  return told;
}

absl::Status WithoutDirectory(const absl::Status& status, const std::string& directory) {
  if (status.ok()) return status;
  absl::Status told(status.code(), WithoutDirectory(status.message(), directory));
  status.ForEachPayload([&](absl::string_view url, const absl::Cord& payload) { told.SetPayload(url, payload); });
  return told;
}

}  // namespace cairn

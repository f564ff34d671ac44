#include "wire/addresses.h"

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

namespace cairn::wire {
namespace {

constexpr absl::string_view kUnix = "unix:";

absl::string_view HostOf(absl::string_view address) { return address.substr(0, address.rfind(':')); }

bool IsLoopbackV4(absl::string_view host) {
  const std::vector<absl::string_view> parts = absl::StrSplit(host, '.');
  if (parts.size() != 4 || parts[0] != "127") return false;
  for (const absl::string_view part : parts) {
    int value = 0;
    if (!absl::SimpleAtoi(part, &value) || value < 0 || value > 255) return false;
  }
  return true;
}

}  // namespace

absl::Status CheckAddress(const std::string& address) {
  const auto bad = [&] {
    return absl::InvalidArgumentError(
        absl::StrCat("\"", address, "\" is no address: give HOST:PORT, as in 127.0.0.1:7878, or unix:/path"));
  };
  if (absl::StartsWith(address, kUnix)) return address.size() > kUnix.size() ? absl::OkStatus() : bad();
  const std::size_t colon = address.rfind(':');
  int port = -1;
  if (colon == std::string::npos || colon == 0 || !absl::SimpleAtoi(address.substr(colon + 1), &port) || port < 0 ||
      port > 65535) {
    return bad();
  }
  const absl::string_view host = HostOf(address);
  const bool bracketed = absl::StartsWith(host, "[") && absl::EndsWith(host, "]");
  return bracketed || !absl::StrContains(host, ':') ? absl::OkStatus() : bad();
}

std::string WithPort(const std::string& address) {
  const bool names_one = absl::EndsWith(address, "]") ? false : absl::StrContains(address, ':');
  return address.empty() || names_one ? address : absl::StrCat(address, ":", kDefaultPort);
}

bool IsLoopback(const std::string& address) {
  if (absl::StartsWith(address, kUnix)) return true;
  const absl::string_view host = HostOf(address);
  return host == "localhost" || host == "[::1]" || IsLoopbackV4(host);
}

}  // namespace cairn::wire

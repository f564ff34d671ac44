#include "client/remote/server_access.h"

#include <cstdlib>
#include <utility>

#include "absl/strings/ascii.h"

namespace cairn::client {
namespace {

// What is empty becomes what the environment says.
void Complete(const char* variable, std::string* value) {
  const char* set = std::getenv(variable);
  if (value->empty() && set != nullptr) *value = std::string(absl::StripAsciiWhitespace(set));
}

bool IsOn(const std::string& text) { return !text.empty() && text != "0"; }

}  // namespace

absl::StatusOr<RemoteOptions> RemoteOptionsFor(const std::string& server, ServerAccess access) {
  std::string tls;
  Complete("CAIRN_TOKEN", &access.token);
  Complete("CAIRN_CA", &access.tls.ca);
  Complete("CAIRN_CERT", &access.tls.certificate);
  Complete("CAIRN_KEY", &access.tls.key);
  Complete("CAIRN_TLS", &tls);
  access.tls.on |= IsOn(tls) || !access.tls.ca.empty() || !access.tls.certificate.empty();
  RemoteOptions options;
  options.server = server;
  options.token = std::move(access.token);
  CAIRN_ASSIGN_OR_RETURN(options.tls, LoadClientTls(access.tls));
  options.token_in_clear = access.token_in_clear;
  return options;
}

}  // namespace cairn::client

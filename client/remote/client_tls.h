// What a client needs to speak TLS with a server.
#pragma once

#include <optional>
#include <string>

#include "base/status.h"

namespace cairn::client {

struct ClientTlsFiles {
  bool on = false;
  std::string ca;           // PEM: whose certificates servers may have; empty: of those whom the machine trusts
  std::string certificate;  // PEM: of the client, where the server asks for one; with `key`, or neither
  std::string key;
};

// The contents of the files.
struct ClientTls {
  std::string ca_pem;
  std::string certificate_pem;
  std::string key_pem;
};

// None unless it is on. Errors name the file; InvalidArgument for one that has no certificate, or no key, in it,
// FailedPrecondition for a key that is not of the certificate.
absl::StatusOr<std::optional<ClientTls>> LoadClientTls(const ClientTlsFiles& files);

}  // namespace cairn::client

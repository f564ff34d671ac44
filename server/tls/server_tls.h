// What a server needs to speak TLS: its certificate and key, checked before it listens, so that what is wrong with them
// is said at the start and not to every client.
#pragma once

#include <cstdint>
#include <string>

#include "base/status.h"

namespace cairn::server {

struct TlsOptions {
  std::string certificate;  // PEM file: the server's, then those between it and its CA; empty: no TLS
  std::string key;          // PEM file, without password
  std::string client_ca;    // PEM file: clients must have a certificate of one of these CAs; empty: they need none

  bool on() const { return !certificate.empty(); }
  // InvalidArgument for a certificate without key and the other way round.
  absl::Status Validate() const;
};

// The contents of the files.
struct ServerTls {
  std::string certificates_pem;
  std::string key_pem;
  std::string client_ca_pem;  // empty: clients need no certificate
  std::int64_t expires_unix_s = 0;
};

// Errors name the file: NotFound, PermissionDenied, ... if it cannot be read, InvalidArgument if it is not what it
// should be, FailedPrecondition for a certificate that is not valid at `now_unix_s` or does not belong to the key.
absl::StatusOr<ServerTls> LoadServerTls(const TlsOptions& options, std::int64_t now_unix_s);

// TLS 1.2 with these, or 1.3: forward secrecy and authenticated encryption only.
inline constexpr const char* kTls12Ciphers = "ECDHE+AESGCM:ECDHE+CHACHA20";

}  // namespace cairn::server

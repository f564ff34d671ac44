// What a client shows a server, and what it must be shown: as somebody says, and where nothing is said as the
// environment does (CAIRN_TOKEN, CAIRN_CA, CAIRN_CERT, CAIRN_KEY, CAIRN_TLS).
#pragma once

#include <string>

#include "base/status.h"
#include "client/remote/remote_map_service.h"

namespace cairn::client {

struct ServerAccess {
  std::string token;
  ClientTlsFiles tls;
  bool token_in_clear = false;
};

// Reads the files that are named; naming one turns TLS on. Errors as of LoadClientTls().
absl::StatusOr<RemoteOptions> RemoteOptionsFor(const std::string& server, ServerAccess access);

}  // namespace cairn::client

// Who asks: as the connection says, and as it turned out.
#pragma once

#include <cstdint>
#include <string>

namespace cairn::server {

// What comes with a request, before anything is believed.
struct Caller {
  std::string peer = {};           // address without port; "unix" for a socket of this machine
  std::string authorization = {};  // the header: "Bearer cairn_..."
  std::string request_id = {};     // that the client chose, if it did
  std::int64_t bytes = 0;          // of the request
};

// Who that is.
struct Client {
  std::string token_name = {};  // empty: this server asks for no tokens
  std::string token_hash = {};  // by which it is found again
  std::string peer = {};
  std::string request_id = {};
  std::string limited_as = {};  // under which ClientLimits count; empty: not limited
};

// Only this machine has such addresses: "unix", 127.0.0.0/8, ::1.
bool IsLoopbackPeer(const std::string& peer);

}  // namespace cairn::server

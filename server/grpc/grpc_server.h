// The calls of cairn.v1 over gRPC, with the health and the reflection service.
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <string>

#include "base/status.h"
#include "server/rpc/calls.h"
#include "server/tls/server_tls.h"

namespace cairn::server {

struct GrpcServerOptions {
  std::string address = "127.0.0.1:7878";     // or unix:/path; port 0: any that is free
  std::optional<ServerTls> tls;               // none: not encrypted. A Unix socket never is
  std::int64_t max_message_bytes = 64 << 20;  // that a client may send
  int max_threads = 64;                       // calls at the same time; more are refused
};

class GrpcServer {
 public:
  // `context.maps` must outlive the server. Unavailable if it cannot listen there.
  static absl::StatusOr<std::unique_ptr<GrpcServer>> Start(const GrpcServerOptions& options,
                                                           const CallContext& context);
  virtual ~GrpcServer() = default;

  // 0 for a Unix socket.
  virtual int port() const = 0;
  // No more calls are taken; those under way get until `grace` is over, and are cancelled then.
  virtual void Stop(std::chrono::milliseconds grace) = 0;
};

}  // namespace cairn::server

// HTTP/1.1 over TCP or TLS, bounded everywhere: connections, headers, bodies, and the time that a client may take for
// each.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "base/status.h"
#include "server/http/message.h"
#include "server/tls/server_tls.h"

namespace cairn::server {

struct HttpServerOptions {
  std::string address = "127.0.0.1:7879";  // HOST:PORT, HOST an address or localhost; port 0: any that is free
  std::optional<ServerTls> tls;            // none: plain HTTP
  std::int64_t max_body_bytes = 64 << 20;  // refused beyond, naming `body_setting`
  std::string body_setting = {};           // by which that is set, for people; empty: none
  std::int64_t max_header_bytes = 16 << 10;
  int max_connections = 256;         // further ones are closed at once
  int threads = 8;                   // requests that are worked on at the same time
  std::chrono::seconds timeout{30};  // for a request to arrive, and for an answer to leave
  // Looks at a request before its body is read: an answer refuses it, and ends the connection. Must be quick and not
  // throw. None: all pass.
  std::function<std::optional<HttpResponse>(const HttpRequest& without_body)> gate;
  // Answers what never got as far as the handler: what is no HTTP, too large or too slow, with this status. `received`:
  // as far as it came. Must be quick and not throw. None: an error without an id.
  std::function<HttpResponse(const HttpRequest& received, const absl::Status& why, int http_status)> on_refused;
};

class HttpServer {
 public:
  using Handler = std::function<HttpResponse(const HttpRequest&)>;

  // `handler` is called by several threads at once and must not throw. InvalidArgument for what is no address,
  // Unavailable if it cannot listen there.
  static absl::StatusOr<std::unique_ptr<HttpServer>> Start(const HttpServerOptions& options, Handler handler);
  virtual ~HttpServer() = default;

  virtual int port() const = 0;
  // No more connections and requests are taken; requests under way get until `grace` is over.
  virtual void Stop(std::chrono::milliseconds grace) = 0;
};

}  // namespace cairn::server

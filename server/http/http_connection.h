// One connection of the HTTP server: requests in, answers out, one after the other, over TCP or over TLS.
#pragma once

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <utility>

#include "server/http/http_server.h"

namespace cairn::server {

class HttpConnection {
 public:
  virtual ~HttpConnection() = default;
  virtual void Close() = 0;
};

// What connections share.
struct HttpConnections {
  HttpConnections(const HttpServerOptions& given, HttpServer::Handler handle, boost::asio::io_context* context)
      : options(given), handler(std::move(handle)), io(*context), workers(static_cast<std::size_t>(given.threads)) {}

  const HttpServerOptions options;
  const HttpServer::Handler handler;
  boost::asio::io_context& io;  // of the server: whatever waits in it keeps its connection, and that this
  boost::asio::thread_pool workers;
  std::optional<boost::asio::ssl::context> tls;  // none: not spoken
  std::atomic<bool> stopping = false;

  std::mutex mutex;  // guards what follows
  std::condition_variable idle;
  int working = 0;     // requests whose answer has not left
  bool ended = false;  // nothing is sent any more; told by `idle`
  std::set<HttpConnection*> connections;
};

// It lives as long as it waits for something.
void ServeConnection(boost::asio::ip::tcp::socket socket, const std::shared_ptr<HttpConnections>& shared);

}  // namespace cairn::server

#include "server/http/http_server.h"

#include <openssl/ssl.h>

#include <boost/asio/buffer.hpp>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <string>
#include <thread>
#include <utility>

#include "absl/strings/numbers.h"
#include "base/guarded.h"
#include "server/http/http_connection.h"

namespace cairn::server {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;
using tcp = asio::ip::tcp;

absl::Status SetTls(const ServerTls& tls, std::optional<asio::ssl::context>* out) {
  asio::ssl::context& context = out->emplace(asio::ssl::context::tls_server);
  SSL_CTX* const native = context.native_handle();
  SSL_CTX_set_min_proto_version(native, TLS1_2_VERSION);
  SSL_CTX_set_cipher_list(native, kTls12Ciphers);
  SSL_CTX_set_options(native, SSL_OP_NO_RENEGOTIATION | SSL_OP_CIPHER_SERVER_PREFERENCE);
  // Connections are kept; to take up earlier ones would need state that all clients share.
  SSL_CTX_set_session_cache_mode(native, SSL_SESS_CACHE_OFF);
  SSL_CTX_set_options(native, SSL_OP_NO_TICKET);
  error_code error;
  context.use_certificate_chain(asio::buffer(tls.certificates_pem), error);
  if (!error) context.use_private_key(asio::buffer(tls.key_pem), asio::ssl::context::pem, error);
  if (!error && !tls.client_ca_pem.empty()) {
    context.add_certificate_authority(asio::buffer(tls.client_ca_pem), error);
    context.set_verify_mode(asio::ssl::verify_peer | asio::ssl::verify_fail_if_no_peer_cert);
  }
  if (!error) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrCat("the certificate cannot be used: ", error.message()));
}

absl::StatusOr<tcp::endpoint> EndpointOf(const std::string& address) {
  const std::size_t colon = address.rfind(':');
  int port = -1;
  std::string host = colon == std::string::npos ? "" : address.substr(0, colon);
  if (host == "localhost") host = "127.0.0.1";
  if (host.size() > 2 && host.front() == '[' && host.back() == ']') host = host.substr(1, host.size() - 2);
  error_code error;
  const asio::ip::address ip = asio::ip::make_address(host, error);
  if (error || !absl::SimpleAtoi(address.substr(colon + 1), &port) || port < 0 || port > 65535) {
    return absl::InvalidArgumentError(
        absl::StrCat("\"", address, "\" is no address for HTTP: give HOST:PORT, as in 127.0.0.1:7879"));
  }
  return tcp::endpoint(ip, static_cast<std::uint16_t>(port));
}

class Server final : public HttpServer {
 public:
  Server(const HttpServerOptions& options, Handler handler)
      : shared_(std::make_shared<HttpConnections>(options, std::move(handler), &io_)), acceptor_(io_), pause_(io_) {}
  ~Server() override { Stop(std::chrono::milliseconds(0)); }

  absl::Status Listen() {
    CAIRN_ASSIGN_OR_RETURN(const tcp::endpoint endpoint, EndpointOf(shared_->options.address));
    if (shared_->options.tls) CAIRN_RETURN_IF_ERROR(SetTls(*shared_->options.tls, &shared_->tls));
    error_code error;
    acceptor_.open(endpoint.protocol(), error);
    if (!error) acceptor_.set_option(asio::socket_base::reuse_address(true), error);
    if (!error) acceptor_.bind(endpoint, error);
    if (!error) acceptor_.listen(asio::socket_base::max_listen_connections, error);
    if (error) {
      return absl::UnavailableError(absl::StrCat("cannot listen on ", shared_->options.address, ": ", error.message()));
    }
    port_ = acceptor_.local_endpoint(error).port();
    Accept();
    CAIRN_ASSIGN_OR_RETURN(thread_, StartThread(
                                        "serving HTTP", [this] { shared_->io.run(); },
                                        [this](const absl::Status&) { shared_->io.stop(); }));
    return absl::OkStatus();
  }

  int port() const override { return port_; }

  void Stop(std::chrono::milliseconds grace) override {
    if (!thread_.joinable()) return;
    shared_->stopping = true;
    asio::post(shared_->io, [this] {
      error_code ignored;
      acceptor_.close(ignored);
    });
    {
      std::unique_lock lock(shared_->mutex);
      shared_->idle.wait_for(lock, grace, [&] { return shared_->working == 0; });
    }
    shared_->io.stop();
    thread_.join();
    {
      const std::lock_guard lock(shared_->mutex);
      shared_->ended = true;
      shared_->idle.notify_all();
    }
    shared_->workers.join();
    error_code ignored;
    acceptor_.close(ignored);  // if there was nothing to wait for, it may have been stopped before it came to that
    const std::lock_guard lock(shared_->mutex);
    for (HttpConnection* connection : shared_->connections) connection->Close();
  }

 private:
  void Accept() {
    acceptor_.async_accept([this](error_code error, tcp::socket socket) {
      if (error == asio::error::operation_aborted || shared_->stopping) return;
      if (error) return AcceptLater();
      if (HasRoom()) ServeConnection(std::move(socket), shared_);
      Accept();
    });
  }

  bool HasRoom() const {
    const std::lock_guard lock(shared_->mutex);
    return static_cast<int>(shared_->connections.size()) < shared_->options.max_connections;
  }

  // No descriptors, or no memory: there may be some in a moment.
  void AcceptLater() {
    pause_.expires_after(std::chrono::milliseconds(100));
    pause_.async_wait([this](error_code error) {
      if (!error) Accept();
    });
  }

  asio::io_context io_{1};
  // It runs until it is stopped, also while all there is to wait for is a worker.
  const asio::executor_work_guard<asio::io_context::executor_type> runs_ = asio::make_work_guard(io_);
  const std::shared_ptr<HttpConnections> shared_;
  tcp::acceptor acceptor_;
  asio::steady_timer pause_;
  std::thread thread_;
  int port_ = 0;
};

}  // namespace

absl::StatusOr<std::unique_ptr<HttpServer>> HttpServer::Start(const HttpServerOptions& options, Handler handler) {
  return Guarded([&]() -> absl::StatusOr<std::unique_ptr<HttpServer>> {
    auto server = std::make_unique<Server>(options, std::move(handler));
    CAIRN_RETURN_IF_ERROR(server->Listen());
    return server;
  });
}

}  // namespace cairn::server

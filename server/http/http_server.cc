#include "server/http/http_server.h"

#include <atomic>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <utility>

#include "absl/strings/numbers.h"
#include "base/guarded.h"
#include "base/version.h"
#include "server/http/http_api.h"

namespace cairn::server {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using boost::system::error_code;
using tcp = asio::ip::tcp;

class Connection;

// What connections share.
struct Shared {
  Shared(const HttpServerOptions& given, HttpServer::Handler handle, asio::io_context* context)
      : options(given), handler(std::move(handle)), io(*context), workers(static_cast<std::size_t>(given.threads)) {}

  const HttpServerOptions options;
  const HttpServer::Handler handler;
  asio::io_context& io;  // of the server: whatever waits in it keeps its connection, and that this
  asio::thread_pool workers;
  std::atomic<bool> stopping = false;

  std::mutex mutex;  // guards what follows
  std::condition_variable idle;
  int working = 0;  // requests whose answer has not left
  std::set<Connection*> connections;
};

HttpResponse TooLarge() {
  HttpResponse response = ErrorResponse(absl::InvalidArgumentError("the body is too large"), "");
  response.status = 413;
  return response;
}

class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(tcp::socket socket, std::shared_ptr<Shared> shared)
      : shared_(std::move(shared)), stream_(std::move(socket)) {
    const std::lock_guard lock(shared_->mutex);
    shared_->connections.insert(this);
  }
  ~Connection() {
    const std::lock_guard lock(shared_->mutex);
    shared_->connections.erase(this);
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void Close() {
    error_code ignored;
    stream_.socket().shutdown(tcp::socket::shutdown_both, ignored);
  }

  void Read() {
    parser_.emplace();
    parser_->body_limit(static_cast<std::uint64_t>(shared_->options.max_body_bytes));
    parser_->header_limit(static_cast<std::uint32_t>(shared_->options.max_header_bytes));
    stream_.expires_after(shared_->options.timeout);
    http::async_read_header(stream_, buffer_, *parser_,
                            [self = shared_from_this()](error_code error, std::size_t) { self->OnHeader(error); });
  }

 private:
  void OnHeader(error_code error) {
    if (error) return OnFailure(error);
    if (parser_->get()[http::field::expect] != "100-continue") return ReadBody();
    // The client asks before it sends the rest.
    http::response<http::empty_body> go_on(http::status::continue_, parser_->get().version());
    error_code write_error;
    http::write(stream_.socket(), go_on, write_error);
    if (write_error) return Close();
    ReadBody();
  }

  void ReadBody() {
    http::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](error_code error, std::size_t) { self->OnRequest(error); });
  }

  void OnRequest(error_code error) {
    if (error) return OnFailure(error);
    stream_.expires_never();
    SetWorking(true);
    asio::post(shared_->workers, [self = shared_from_this()] {
      HttpResponse response = self->Handled();
      asio::post(self->shared_->io, [self, response = std::move(response)]() mutable {
        self->Write(std::move(response), self->parser_->get().keep_alive() && !self->shared_->stopping);
      });
    });
  }

  HttpResponse Handled() {
    http::request<http::string_body>& received = parser_->get();
    HttpRequest request;
    request.method = std::string(received.method_string());
    request.path = std::string(received.target().substr(0, received.target().find('?')));
    request.content_type = std::string(received[http::field::content_type]);
    request.body = std::move(received.body());
    return shared_->handler(request);
  }

  // What is no HTTP, or too large, is told so; a client that is gone or too slow is not.
  void OnFailure(error_code error) {
    if (error == http::error::body_limit || error == http::error::header_limit) return Write(TooLarge(), false);
    const bool malformed = error.category() == make_error_code(http::error::bad_method).category();
    if (!malformed || error == http::error::end_of_stream || error == http::error::partial_message) return Close();
    Write(ErrorResponse(absl::InvalidArgumentError(absl::StrCat("this is no HTTP request: ", error.message())), ""),
          false);
  }

  void Write(HttpResponse&& answer, bool keep_alive) {
    const bool head = parser_->is_header_done() && parser_->get().method() == http::verb::head;
    answer_.emplace(static_cast<http::status>(answer.status), 11);
    answer_->set(http::field::server, std::string("cairnd/") + kVersion);
    answer_->set(http::field::content_type, answer.content_type);
    for (const auto& [name, value] : answer.headers) answer_->set(name, value);
    answer_->keep_alive(keep_alive);
    answer_->content_length(answer.body.size());
    if (!head) answer_->body() = std::move(answer.body);
    stream_.expires_after(shared_->options.timeout);
    http::async_write(stream_, *answer_, [self = shared_from_this(), keep_alive](error_code error, std::size_t) {
      self->SetWorking(false);
      if (error || !keep_alive) return self->Close();
      self->Read();
    });
  }

  void SetWorking(bool working) {
    const std::lock_guard lock(shared_->mutex);
    if (working_ == working) return;
    working_ = working;
    shared_->working += working ? 1 : -1;
    if (!working) shared_->idle.notify_all();
  }

  const std::shared_ptr<Shared> shared_;
  beast::tcp_stream stream_;
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::string_body>> parser_;
  std::optional<http::response<http::string_body>> answer_;
  bool working_ = false;  // with the lock of shared_
};

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
      : shared_(std::make_shared<Shared>(options, std::move(handler), &io_)), acceptor_(io_), pause_(io_) {}
  ~Server() override { Stop(std::chrono::milliseconds(0)); }

  absl::Status Listen() {
    CAIRN_ASSIGN_OR_RETURN(const tcp::endpoint endpoint, EndpointOf(shared_->options.address));
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
    shared_->workers.join();
    error_code ignored;
    acceptor_.close(ignored);  // if there was nothing to wait for, it may have been stopped before it came to that
    const std::lock_guard lock(shared_->mutex);
    for (Connection* connection : shared_->connections) connection->Close();
  }

 private:
  void Accept() {
    acceptor_.async_accept([this](error_code error, tcp::socket socket) {
      if (error == asio::error::operation_aborted || shared_->stopping) return;
      if (error) return AcceptLater();
      if (HasRoom()) std::make_shared<Connection>(std::move(socket), shared_)->Read();
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
  const std::shared_ptr<Shared> shared_;
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

#include "server/http/http_connection.h"

#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <string>

#include "base/version.h"
#include "server/http/http_api.h"
#include "server/http/http_stream.h"

namespace cairn::server {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using boost::system::error_code;
using tcp = asio::ip::tcp;

absl::Status TooLarge(const char* what, std::int64_t most, absl::string_view setting = "") {
  const std::string by = setting.empty() ? "" : absl::StrCat(", as many as this server takes (", setting, ")");
  return absl::InvalidArgumentError(absl::StrCat("the ", what, " of more than ", most, " bytes", by));
}

class Connection final : public HttpConnection, public std::enable_shared_from_this<Connection> {
 public:
  Connection(std::shared_ptr<HttpConnections> shared, std::string peer, std::unique_ptr<HttpStream> stream)
      : shared_(std::move(shared)), peer_(std::move(peer)), stream_(std::move(stream)) {
    const std::lock_guard lock(shared_->mutex);
    shared_->connections.insert(this);
  }
  ~Connection() override {
    const std::lock_guard lock(shared_->mutex);
    shared_->connections.erase(this);
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void Close() override {
    error_code ignored;
    Tcp().socket().shutdown(tcp::socket::shutdown_both, ignored);
  }

  void Start() {
    Tcp().expires_after(shared_->options.timeout);
    stream_->Handshake([self = shared_from_this()](error_code error) {
      if (error) return self->Close();
      self->Read();
    });
  }

 private:
  beast::tcp_stream& Tcp() { return stream_->Tcp(); }

  void Read() {
    parser_.emplace();
    parser_->body_limit(static_cast<std::uint64_t>(shared_->options.max_body_bytes));
    parser_->header_limit(static_cast<std::uint32_t>(shared_->options.max_header_bytes));
    Tcp().expires_never();
    AwaitRequest();
    http::async_read_header(*stream_, buffer_, *parser_,
                            [self = shared_from_this()](error_code error, std::size_t) { self->OnHeader(error); });
  }

  // The stream's own timeout would close it, and who is too slow is to be told so.
  void AwaitRequest() {
    late_ = false;
    arriving_ = true;
    EndReadingAfter(shared_->options.timeout);
  }
  void EndReadingAfter(std::chrono::milliseconds time) {
    arrival_.expires_after(time);
    arrival_.async_wait([weak = weak_from_this()](error_code error) {
      const auto self = weak.lock();
      if (error || self == nullptr || !self->arriving_) return;
      self->late_ = true;
      self->Tcp().cancel();
      // Between two reads there was nothing to be ended.
      constexpr std::chrono::milliseconds kAgain(100);
      self->EndReadingAfter(kAgain);
    });
  }
  void EndArrival() {
    arriving_ = false;
    arrival_.cancel();
  }

  void OnHeader(error_code error) {
    if (error) return OnFailure(error);
    if (shared_->options.gate) {
      std::optional<HttpResponse> refusal = shared_->options.gate(Received());
      if (refusal) {
        EndArrival();
        return Write(*std::move(refusal), false);
      }
    }
    if (parser_->get()[http::field::expect] != "100-continue") return ReadBody();
    // The client asks before it sends the rest.
    go_on_.emplace(http::status::continue_, parser_->get().version());
    http::async_write(*stream_, *go_on_, [self = shared_from_this()](error_code write_error, std::size_t) {
      if (write_error) return self->OnFailure(write_error);
      self->ReadBody();
    });
  }

  void ReadBody() {
    http::async_read(*stream_, buffer_, *parser_,
                     [self = shared_from_this()](error_code error, std::size_t) { self->OnRequest(error); });
  }

  void OnRequest(error_code error) {
    if (error) return OnFailure(error);
    EndArrival();
    SetWorking(true);
    asio::post(shared_->workers, [self = shared_from_this()] {
      HttpResponse response = self->Handled();
      asio::post(self->shared_->io, [self, response = std::move(response)]() mutable {
        self->Write(std::move(response), self->parser_->get().keep_alive() && !self->shared_->stopping);
      });
    });
  }

  // As far as it has arrived.
  HttpRequest Received() {
    const http::request<http::string_body>& received = parser_->get();
    HttpRequest request;
    request.method = std::string(received.method_string());
    const std::size_t query = received.target().find('?');
    request.path = std::string(received.target().substr(0, query));
    if (query != beast::string_view::npos) request.query = std::string(received.target().substr(query + 1));
    request.content_type = std::string(received[http::field::content_type]);
    request.peer = peer_;
    request.accept = std::string(received[http::field::accept]);
    request.authorization = std::string(received[http::field::authorization]);
    request.request_id = std::string(received["X-Request-Id"]);
    request.origin = std::string(received[http::field::origin]);
    request.content_encoding = std::string(received[http::field::content_encoding]);
    return request;
  }

  HttpResponse Handled() {
    HttpRequest request = Received();
    request.body = std::move(parser_->get().body());
    if (request.method != "HEAD") {
      request.send_part = [this](const HttpResponse& head, absl::string_view part) { return SendPart(head, part); };
    }
    return shared_->handler(request);
  }

  // By a worker, which waits until the part has left.
  absl::Status SendPart(const HttpResponse& head, absl::string_view part) {
    {
      const std::lock_guard lock(shared_->mutex);
      part_sent_.reset();
    }
    asio::post(shared_->io, [self = shared_from_this(), head = head_.has_value() ? HttpResponse() : head,
                             text = std::string(part)]() mutable { self->WritePart(head, std::move(text)); });
    std::unique_lock lock(shared_->mutex);
    shared_->idle.wait(lock, [&] { return part_sent_.has_value() || shared_->ended; });
    if (!part_sent_) return absl::CancelledError("the server stops");
    return *part_sent_ ? absl::CancelledError("the client went away, or reads too slowly") : absl::OkStatus();
  }

  void WritePart(const HttpResponse& head, std::string text) {
    part_ = std::move(text);
    Tcp().expires_after(shared_->options.timeout);
    if (head_) return WriteChunk();
    head_.emplace(static_cast<http::status>(head.status), 11);
    SetHeaders(head, true, &*head_);
    head_->chunked(true);
    head_serializer_.emplace(*head_);
    http::async_write_header(*stream_, *head_serializer_, [self = shared_from_this()](error_code error, std::size_t) {
      if (error) return self->NotePart(error);
      self->WriteChunk();
    });
  }

  void WriteChunk() {
    asio::async_write(*stream_, http::make_chunk(asio::buffer(part_)),
                      [self = shared_from_this()](error_code error, std::size_t) { self->NotePart(error); });
  }

  void NotePart(error_code error) {
    Tcp().expires_never();
    const std::lock_guard lock(shared_->mutex);
    part_sent_ = error;
    shared_->idle.notify_all();
  }

  // After the last part.
  void WriteEnd(bool keep_alive) {
    head_serializer_.reset();
    head_.reset();
    Tcp().expires_after(shared_->options.timeout);
    asio::async_write(
        *stream_, http::make_chunk_last(),
        [self = shared_from_this(), keep_alive](error_code error, std::size_t) { self->OnWritten(error, keep_alive); });
  }

  // What is no HTTP, too large or too slow is told so; a client that is gone is not, nor one that has only kept its
  // connection for a request that it did not begin.
  void OnFailure(error_code error) {
    EndArrival();
    if (late_ && error == asio::error::operation_aborted) {
      if (!parser_->got_some() && buffer_.size() == 0) return Close();
      return Refuse(absl::DeadlineExceededError(
                        absl::StrCat("the request did not arrive within ", shared_->options.timeout.count(), " s")),
                    408);
    }
    if (error == http::error::header_limit) {
      return Refuse(TooLarge("request has headers", shared_->options.max_header_bytes), 431);
    }
    if (error == http::error::body_limit) {
      return Refuse(TooLarge("request has a body", shared_->options.max_body_bytes, shared_->options.body_setting),
                    413);
    }
    const bool malformed = error.category() == make_error_code(http::error::bad_method).category();
    if (!malformed || error == http::error::end_of_stream || error == http::error::partial_message) return Close();
    Refuse(absl::InvalidArgumentError(absl::StrCat("this is no HTTP request: ", error.message())), 400);
  }

  void Refuse(const absl::Status& why, int http_status) {
    if (shared_->options.on_refused) return Write(shared_->options.on_refused(Received(), why, http_status), false);
    HttpResponse response = ErrorResponse(why, "");
    response.status = http_status;
    Write(std::move(response), false);
  }

  template <class Head>
  static void SetHeaders(const HttpResponse& answer, bool keep_alive, Head* head) {
    head->set(http::field::server, std::string("cairnd/") + kVersion);
    head->set(http::field::content_type, answer.content_type);
    for (const auto& [name, value] : answer.headers) head->set(name, value);
    head->keep_alive(keep_alive);
  }

  void Write(HttpResponse&& answer, bool keep_alive) {
    if (answer.parts == HttpResponse::Parts::kAll) return WriteEnd(keep_alive);
    if (answer.parts == HttpResponse::Parts::kBroken) {  // without an end the client knows that something is missing
      SetWorking(false);
      return Close();
    }
    const bool head = parser_->is_header_done() && parser_->get().method() == http::verb::head;
    answer_.emplace(static_cast<http::status>(answer.status), 11);
    SetHeaders(answer, keep_alive, &*answer_);
    answer_->content_length(answer.body.size());
    if (!head) answer_->body() = std::move(answer.body);
    Tcp().expires_after(shared_->options.timeout);
    http::async_write(*stream_, *answer_, [self = shared_from_this(), keep_alive](error_code error, std::size_t) {
      self->OnWritten(error, keep_alive);
    });
  }

  void OnWritten(error_code error, bool keep_alive) {
    SetWorking(false);
    if (error) return Close();
    if (!keep_alive) return End();
    Read();
  }

  // The client is told that this was all.
  void End() {
    stream_->Shutdown([self = shared_from_this()](error_code) { self->Close(); });
  }

  void SetWorking(bool working) {
    const std::lock_guard lock(shared_->mutex);
    if (working_ == working) return;
    working_ = working;
    shared_->working += working ? 1 : -1;
    if (!working) shared_->idle.notify_all();
  }

  const std::shared_ptr<HttpConnections> shared_;
  const std::string peer_;
  const std::unique_ptr<HttpStream> stream_;
  asio::steady_timer arrival_{stream_->get_executor()};  // of a request, all of it
  bool arriving_ = false;
  bool late_ = false;
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::string_body>> parser_;
  std::optional<http::response<http::empty_body>> go_on_;
  std::optional<http::response<http::string_body>> answer_;
  // Of an answer whose body goes out in parts.
  std::optional<http::response<http::empty_body>> head_;
  std::optional<http::response_serializer<http::empty_body>> head_serializer_;
  std::string part_;
  std::optional<error_code> part_sent_;  // with the lock of shared_; none: it is under way
  bool working_ = false;                 // with the lock of shared_
};

}  // namespace

void ServeConnection(tcp::socket socket, const std::shared_ptr<HttpConnections>& shared) {
  error_code gone;
  const tcp::endpoint peer = socket.remote_endpoint(gone);
  if (gone) return;
  const std::string address = peer.address().to_string();
  std::unique_ptr<HttpStream> stream =
      shared->tls ? TlsStream(std::move(socket), &*shared->tls) : PlainStream(std::move(socket));
  std::make_shared<Connection>(shared, address, std::move(stream))->Start();
}

}  // namespace cairn::server

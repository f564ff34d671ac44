#include "server/http/http_stream.h"

#include <boost/beast/ssl.hpp>

namespace cairn::server {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
using tcp = asio::ip::tcp;

class Plain final : public HttpStream {
 public:
  explicit Plain(tcp::socket socket) : stream_(std::move(socket)) {}
  beast::tcp_stream& Tcp() override { return stream_; }
  void Handshake(Finished finished) override { finished({}); }
  void Shutdown(Finished finished) override { finished({}); }

 private:
  void ReadSome(asio::mutable_buffer into, Done done) override { stream_.async_read_some(into, std::move(done)); }
  void WriteSome(std::vector<asio::const_buffer> from, Done done) override {
    stream_.async_write_some(from, std::move(done));
  }

  beast::tcp_stream stream_;
};

class Tls final : public HttpStream {
 public:
  Tls(tcp::socket socket, asio::ssl::context* tls) : stream_(std::move(socket), *tls) {}
  beast::tcp_stream& Tcp() override { return beast::get_lowest_layer(stream_); }
  void Handshake(Finished finished) override {
    stream_.async_handshake(asio::ssl::stream_base::server, std::move(finished));
  }
  void Shutdown(Finished finished) override { stream_.async_shutdown(std::move(finished)); }

 private:
  void ReadSome(asio::mutable_buffer into, Done done) override { stream_.async_read_some(into, std::move(done)); }
  void WriteSome(std::vector<asio::const_buffer> from, Done done) override {
    stream_.async_write_some(from, std::move(done));
  }

  beast::ssl_stream<beast::tcp_stream> stream_;
};

}  // namespace

std::unique_ptr<HttpStream> PlainStream(tcp::socket socket) { return std::make_unique<Plain>(std::move(socket)); }

std::unique_ptr<HttpStream> TlsStream(tcp::socket socket, asio::ssl::context* tls) {
  return std::make_unique<Tls>(std::move(socket), tls);
}

}  // namespace cairn::server

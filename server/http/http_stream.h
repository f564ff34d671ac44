// The bytes of a connection, over TLS or not: an AsyncReadStream and AsyncWriteStream in the terms of Boost.Beast. What
// reads and writes HTTP is compiled once for both, instead of once for each: its templates are most of what compiling
// this folder takes.
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <boost/asio/async_result.hpp>
#include <boost/asio/buffer.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <cstddef>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

namespace cairn::server {

class HttpStream {
 public:
  using executor_type = boost::asio::any_io_executor;
  using Done = std::function<void(boost::system::error_code, std::size_t bytes)>;
  using Finished = std::function<void(boost::system::error_code)>;

  virtual ~HttpStream() = default;

  // What is below TLS; its timeouts hold for all that waits here.
  virtual boost::beast::tcp_stream& Tcp() = 0;
  // What TLS begins and ends with; without it `finished` is called at once.
  virtual void Handshake(Finished finished) = 0;
  virtual void Shutdown(Finished finished) = 0;

  executor_type get_executor() { return Tcp().get_executor(); }

  template <class Buffers, class Token>
  auto async_read_some(const Buffers& buffers, Token&& token) {
    return boost::asio::async_initiate<Token, void(boost::system::error_code, std::size_t)>(
        [this](auto handler, const Buffers& into) {
          ReadSome(First<boost::asio::mutable_buffer>(into), Shared(std::move(handler)));
        },
        token, buffers);
  }
  template <class Buffers, class Token>
  auto async_write_some(const Buffers& buffers, Token&& token) {
    return boost::asio::async_initiate<Token, void(boost::system::error_code, std::size_t)>(
        [this](auto handler, const Buffers& from) {
          WriteSome(std::vector<boost::asio::const_buffer>(boost::asio::buffer_sequence_begin(from),
                                                           boost::asio::buffer_sequence_end(from)),
                    Shared(std::move(handler)));
        },
        token, buffers);
  }

 private:
  virtual void ReadSome(boost::asio::mutable_buffer into, Done done) = 0;
  virtual void WriteSome(std::vector<boost::asio::const_buffer> from, Done done) = 0;

  // The first that is not empty: to read some means to fill as much as one likes.
  template <class Buffer, class Buffers>
  static Buffer First(const Buffers& buffers) {
    for (auto at = boost::asio::buffer_sequence_begin(buffers); at != boost::asio::buffer_sequence_end(buffers); ++at) {
      if (Buffer(*at).size() > 0) return *at;
    }
    return {};
  }
  // Handlers can be moved only, and std::function copies.
  template <class Handler>
  static Done Shared(Handler handler) {
    return [kept = std::make_shared<Handler>(std::move(handler))](boost::system::error_code error, std::size_t bytes) {
      (*kept)(error, bytes);
    };
  }
};

std::unique_ptr<HttpStream> PlainStream(boost::asio::ip::tcp::socket socket);
std::unique_ptr<HttpStream> TlsStream(boost::asio::ip::tcp::socket socket, boost::asio::ssl::context* tls);

}  // namespace cairn::server

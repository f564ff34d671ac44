#include "server/http/http_server.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/asio/write.hpp>
#include <future>
#include <mutex>
#include <thread>
#include <vector>

#include "server/tls/testing_certificates.h"

namespace cairn::server {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

HttpServerOptions Options() {
  HttpServerOptions options;
  options.address = "127.0.0.1:0";
  options.max_body_bytes = 1000;
  options.max_header_bytes = 2000;
  return options;
}

HttpResponse Echo(const HttpRequest& request) {
  return {200, "text/plain", request.method + " " + request.path + " " + request.body};
}

// Speaks as it is told, whether that is HTTP or not.
class Client {
 public:
  explicit Client(int port) : socket_(io_) {
    socket_.connect({asio::ip::make_address("127.0.0.1"), static_cast<std::uint16_t>(port)});
  }
  void Send(const std::string& bytes) { asio::write(socket_, asio::buffer(bytes)); }
  void EndOfRequest() { socket_.shutdown(tcp::socket::shutdown_send); }
  // What comes until the server closes.
  std::string ReadAll() {
    std::string bytes;
    boost::system::error_code error;
    asio::read(socket_, asio::dynamic_buffer(bytes), error);
    return bytes;
  }
  std::string ReadUntil(const std::string& end) {
    std::string bytes;
    while (bytes.find(end) == std::string::npos) {
      std::array<char, 256> some;
      boost::system::error_code error;
      const std::size_t read = socket_.read_some(asio::buffer(some), error);
      if (error) break;
      bytes.append(some.data(), read);
    }
    return bytes;
  }

 private:
  asio::io_context io_;
  tcp::socket socket_;
};

// A client that speaks TLS, and trusts `ca`.
class TlsClient {
 public:
  TlsClient(int port, const std::string& ca_pem, int max_version = 0) : stream_(io_, context_) {
    context_.add_certificate_authority(asio::buffer(ca_pem));
    stream_.set_verify_mode(asio::ssl::verify_peer);
    stream_.set_verify_callback(asio::ssl::host_name_verification("localhost"));
    if (max_version != 0) SSL_set_max_proto_version(stream_.native_handle(), max_version);
    stream_.next_layer().connect({asio::ip::make_address("127.0.0.1"), static_cast<std::uint16_t>(port)});
    stream_.handshake(asio::ssl::stream_base::client, handshake_);
  }
  const boost::system::error_code& handshake() const { return handshake_; }
  std::string Ask(const std::string& request) {
    boost::system::error_code error;
    asio::write(stream_, asio::buffer(request), error);
    std::string bytes;
    asio::read(stream_, asio::dynamic_buffer(bytes), error);
    return bytes;
  }

 private:
  asio::io_context io_;
  asio::ssl::context context_{asio::ssl::context::tls_client};
  asio::ssl::stream<tcp::socket> stream_;
  boost::system::error_code handshake_;
};

TEST(HttpServer, AnswersAndKeepsTheConnection) {
  const auto server = HttpServer::Start(Options(), Echo);
  ASSERT_TRUE(server.ok()) << server.status();
  Client client((*server)->port());
  client.Send("GET /a?b=c HTTP/1.1\r\nHost: x\r\n\r\n");
  const std::string first = client.ReadUntil("GET /a ");
  EXPECT_THAT(first, StartsWith("HTTP/1.1 200 OK\r\n"));
  EXPECT_THAT(first, HasSubstr("Content-Type: text/plain"));
  client.Send("POST /d HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\nConnection: close\r\n\r\nhello");
  EXPECT_THAT(client.ReadAll(), HasSubstr("POST /d hello"));
}

TEST(HttpServer, RequestsMayBeRefusedBeforeTheirBodyIsRead) {
  HttpServerOptions options = Options();
  options.gate = [](const HttpRequest& request) -> std::optional<HttpResponse> {
    if (request.authorization == "Bearer x") return std::nullopt;
    return HttpResponse{401, "text/plain", "who are you?"};
  };
  const auto server = *HttpServer::Start(options, Echo);
  const std::string head = "POST /d HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\nConnection: close\r\n";
  Client stranger(server->port());
  stranger.Send(head + "\r\n");  // and never the body
  EXPECT_THAT(stranger.ReadAll(), testing::AllOf(StartsWith("HTTP/1.1 401"), testing::EndsWith("who are you?")));
  Client known(server->port());
  known.Send(head + "Authorization: Bearer x\r\n\r\nhello");
  EXPECT_THAT(known.ReadAll(), HasSubstr("POST /d hello"));
}

TEST(HttpServer, AnswersHeadWithoutABody) {
  const auto server = *HttpServer::Start(Options(), Echo);
  Client client(server->port());
  client.Send("HEAD /a HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
  const std::string answer = client.ReadAll();
  EXPECT_THAT(answer, HasSubstr("Content-Length: 8"));
  EXPECT_THAT(answer, testing::EndsWith("\r\n\r\n"));
}

TEST(HttpServer, ClientsThatAskFirstAreToldToGoOn) {
  const auto server = *HttpServer::Start(Options(), Echo);
  Client client(server->port());
  client.Send("POST /d HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\nExpect: 100-continue\r\nConnection: close\r\n\r\n");
  EXPECT_THAT(client.ReadUntil("\r\n\r\n"), StartsWith("HTTP/1.1 100 Continue"));
  client.Send("hello");
  EXPECT_THAT(client.ReadAll(), HasSubstr("POST /d hello"));
}

TEST(HttpServer, BodiesGoOutInParts) {
  const auto parts = [](const HttpRequest& request) {
    HttpResponse response{200, "text/plain", ""};
    const bool sent = request.send_part(response, "first ").ok() && request.send_part(response, request.query).ok();
    response.parts = sent && request.path == "/all" ? HttpResponse::Parts::kAll : HttpResponse::Parts::kBroken;
    return response;
  };
  const auto server = HttpServer::Start(Options(), parts);
  ASSERT_TRUE(server.ok()) << server.status();
  Client all((*server)->port());
  all.Send("GET /all?a=1&b=%20 HTTP/1.1\r\nHost: x\r\n\r\nGET /half?z HTTP/1.1\r\nHost: x\r\n\r\n");
  const std::string answers = all.ReadAll();
  EXPECT_THAT(answers, StartsWith("HTTP/1.1 200 OK\r\n"));
  EXPECT_THAT(answers, HasSubstr("Transfer-Encoding: chunked\r\n"));
  EXPECT_THAT(answers, HasSubstr("\r\n\r\n6\r\nfirst \r\n9\r\na=1&b=%20\r\n0\r\n\r\nHTTP/1.1 200 OK\r\n"))
      << "kept alive";
  EXPECT_THAT(answers, testing::EndsWith("6\r\nfirst \r\n1\r\nz\r\n")) << "the second one has no end";
}

// One that does not read holds nobody up who stops the server.
TEST(HttpServer, StopsWhileAPartIsUnderWay) {
  std::promise<absl::Status> ended;
  const auto endless = [&](const HttpRequest& request) {
    HttpResponse response{200, "text/plain", ""};
    const std::string part(1 << 20, 'x');
    absl::Status sent;
    while (sent.ok()) sent = request.send_part(response, part);
    ended.set_value(sent);
    response.parts = HttpResponse::Parts::kBroken;
    return response;
  };
  auto server = HttpServer::Start(Options(), endless);
  ASSERT_TRUE(server.ok()) << server.status();
  Client client((*server)->port());
  client.Send("GET / HTTP/1.1\r\nHost: x\r\n\r\n");
  client.ReadUntil("xxxx");
  (*server)->Stop(std::chrono::milliseconds(0));
  EXPECT_TRUE(absl::IsCancelled(ended.get_future().get()));
}

TEST(HttpServer, WhatIsTooLargeOrNoHttpIsRefusedAndTheServerGoesOn) {
  const auto server = *HttpServer::Start(Options(), Echo);
  const auto answer_to = [&](const std::string& bytes) {
    Client client(server->port());
    client.Send(bytes);
    return client.ReadAll();
  };
  EXPECT_THAT(answer_to("POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 1001\r\n\r\n"),
              AllOf(HasSubstr("413"), HasSubstr("has a body of more than 1000")));
  EXPECT_THAT(answer_to("GET / HTTP/1.1\r\nHost: " + std::string(3000, 'x') + "\r\n\r\n"),
              AllOf(HasSubstr("431"), HasSubstr("has headers of more than 2000 bytes")));
  EXPECT_THAT(answer_to("\x16\x03\x01 this is TLS\r\n\r\n"), StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(answer_to("GET / HTTP/9.9\r\n\r\n"), StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(answer_to("POST / HTTP/1.1\r\nContent-Length: minus one\r\n\r\n"), StartsWith("HTTP/1.1 400"));
  {
    Client gone(server->port());
    gone.Send("POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 100\r\n\r\nhalf of it");
    gone.EndOfRequest();
    EXPECT_EQ(gone.ReadAll(), "");
  }
  EXPECT_THAT(answer_to("GET /a HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n"), HasSubstr("GET /a "));
}

// Whoever answers them knows as much of them as has come.
TEST(HttpServer, WhatIsRefusedUnreadKeepsItsRequestId) {
  HttpServerOptions options = Options();
  options.on_refused = [](const HttpRequest& received, const absl::Status& why, int status) {
    return HttpResponse{status, "text/plain", absl::StrCat(received.request_id, "|", why.message())};
  };
  options.body_setting = "--most";
  const auto server = *HttpServer::Start(options, Echo);
  const auto answer_to = [&](const std::string& bytes) {
    Client client(server->port());
    client.Send(bytes);
    return client.ReadAll();
  };
  EXPECT_THAT(answer_to("POST / HTTP/1.1\r\nHost: x\r\nX-Request-Id: a7\r\nContent-Length: 1001\r\n\r\n"),
              AllOf(StartsWith("HTTP/1.1 413"), HasSubstr("a7|"), HasSubstr("(--most)")));
  EXPECT_THAT(answer_to("GET / HTTP/1.1\r\nX-Request-Id: a8\r\nHost: " + std::string(3000, 'x') + "\r\n\r\n"),
              StartsWith("HTTP/1.1 431"));
  EXPECT_THAT(answer_to("no HTTP\r\n\r\n"), AllOf(StartsWith("HTTP/1.1 400"), HasSubstr("|this is no HTTP")));
}

TEST(HttpServer, ConnectionsAreCountedAndSlowOnesClosed) {
  HttpServerOptions options = Options();
  options.max_connections = 2;
  options.timeout = std::chrono::seconds(1);
  const auto server = *HttpServer::Start(options, Echo);
  Client slow(server->port()), other(server->port());
  slow.Send("GET / HTTP/1.1\r\nHo");
  other.Send("GET /b HTTP/1.1\r\nHost: x\r\n\r\n");
  EXPECT_THAT(other.ReadUntil("GET /b "), HasSubstr("200 OK"));
  Client third(server->port());
  EXPECT_EQ(third.ReadAll(), "") << "closed at once";
  EXPECT_THAT(slow.ReadAll(), StartsWith("HTTP/1.1 408")) << "closed when its time is over";
}

TEST(HttpServer, WhoBeginsARequestAndDoesNotEndItIsToldSo) {
  HttpServerOptions options = Options();
  options.timeout = std::chrono::seconds(1);
  std::mutex mutex;
  std::vector<absl::Status> refused;
  options.on_refused = [&](const HttpRequest& received, const absl::Status& why, int status) {
    const std::lock_guard lock(mutex);
    EXPECT_EQ(received.peer, "127.0.0.1");
    refused.push_back(why);
    return HttpResponse{status, "text/plain", std::string(why.message())};
  };
  const TestingCertificate ca = MakeTestingCa(), own = MakeTestingCertificate({}, &ca);
  HttpServerOptions with_tls = options;
  with_tls.tls = ServerTls{own.certificate_pem, own.key_pem, "", 0};
  const auto server = *HttpServer::Start(options, Echo), secure = *HttpServer::Start(with_tls, Echo);
  const std::string head = "POST /d HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\n";
  Client in_headers(server->port()), in_body(server->port()), asks(server->port()), idle(server->port());
  in_headers.Send(head);
  in_body.Send(head + "\r\nhel");
  asks.Send(head + "Expect: 100-continue\r\n\r\n");
  const auto told = AllOf(HasSubstr("HTTP/1.1 408 Request Timeout"), HasSubstr("Connection: close"),
                          HasSubstr("did not arrive within 1 s"));
  EXPECT_THAT(in_headers.ReadAll(), told);
  EXPECT_THAT(in_body.ReadAll(), told);
  EXPECT_THAT(asks.ReadAll(), told);
  EXPECT_EQ(idle.ReadAll(), "") << "it has begun none";
  EXPECT_THAT(TlsClient(secure->port(), ca.certificate_pem).Ask(head + "\r\nhel"), told);
  const std::lock_guard lock(mutex);
  EXPECT_EQ(refused.size(), 4u);
  for (const absl::Status& why : refused) EXPECT_TRUE(absl::IsDeadlineExceeded(why)) << why;
}

// However steadily.
TEST(HttpServer, WhoSendsARequestLetterByLetterIsToldSo) {
  HttpServerOptions options = Options();
  options.timeout = std::chrono::seconds(1);
  const auto server = *HttpServer::Start(options, Echo);
  Client client(server->port());
  std::thread writing([&] {
    try {
      for (int i = 0; i < 400; ++i) {
        client.Send(i == 0 ? "GET /" : "a");
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
      }
    } catch (const boost::system::system_error&) {  // it was closed
    }
  });
  EXPECT_THAT(client.ReadUntil("408"), StartsWith("HTTP/1.1 408"));
  writing.join();
}

TEST(HttpServer, SpeaksTlsOfToday) {
  const TestingCertificate ca = MakeTestingCa(), own = MakeTestingCertificate({}, &ca);
  HttpServerOptions options = Options();
  options.tls = ServerTls{own.certificate_pem, own.key_pem, "", 0};
  const auto server = HttpServer::Start(options, Echo);
  ASSERT_TRUE(server.ok()) << server.status();
  const std::string request =
      "POST /a HTTP/1.1\r\nHost: x\r\nConnection: close\r\nExpect: 100-continue\r\n"
      "Content-Length: 5\r\n\r\nhello";
  TlsClient client((*server)->port(), ca.certificate_pem);
  ASSERT_FALSE(client.handshake()) << client.handshake().message();
  EXPECT_THAT(client.Ask(request), HasSubstr("POST /a hello"));
  EXPECT_FALSE(TlsClient((*server)->port(), ca.certificate_pem, TLS1_2_VERSION).handshake());
  EXPECT_TRUE(TlsClient((*server)->port(), ca.certificate_pem, TLS1_1_VERSION).handshake());
  EXPECT_TRUE(TlsClient((*server)->port(), MakeTestingCa().certificate_pem).handshake());
  Client plain((*server)->port());
  plain.Send("GET / HTTP/1.1\r\nHost: x\r\n\r\n");
  EXPECT_THAT(plain.ReadAll(), testing::Not(HasSubstr("HTTP/1.1 200")));
}

TEST(HttpServer, MayAskForCertificatesOfClientsAndClosesWhoSaysNothing) {
  const TestingCertificate ca = MakeTestingCa(), own = MakeTestingCertificate({}, &ca);
  HttpServerOptions options = Options();
  options.tls = ServerTls{own.certificate_pem, own.key_pem, ca.certificate_pem, 0};
  options.timeout = std::chrono::seconds(1);
  const auto server = *HttpServer::Start(options, Echo);
  // In TLS 1.3 a client learns only afterwards that it was refused.
  EXPECT_EQ(TlsClient(server->port(), ca.certificate_pem).Ask("GET / HTTP/1.1\r\nHost: x\r\n\r\n"), "");
  Client silent(server->port());
  EXPECT_EQ(silent.ReadAll(), "") << "closed when its time is over";
}

TEST(HttpServer, StopsInOrder) {
  std::promise<void> begun;
  std::promise<void> go_on;
  std::shared_future<void> released = go_on.get_future().share();
  auto server = *HttpServer::Start(Options(), [&](const HttpRequest& request) {
    begun.set_value();
    released.wait();
    return Echo(request);
  });
  const int port = server->port();
  Client client(port);
  client.Send("GET /under_way HTTP/1.1\r\nHost: x\r\n\r\n");
  begun.get_future().wait();
  std::thread stopping([&] { server->Stop(std::chrono::seconds(10)); });
  go_on.set_value();
  EXPECT_THAT(client.ReadAll(), HasSubstr("GET /under_way "));
  stopping.join();
  EXPECT_THROW(Client refused(port), boost::system::system_error);
}

TEST(HttpServer, AddressesThatAreNoneOrTaken) {
  HttpServerOptions options = Options();
  const auto server = *HttpServer::Start(options, Echo);
  options.address = "127.0.0.1:" + std::to_string(server->port());
  EXPECT_EQ(HttpServer::Start(options, Echo).status().code(), absl::StatusCode::kUnavailable);
  for (const char* bad : {"", "7879", "nowhere.example:1", "127.0.0.1:x", "127.0.0.1:99999", "unix:/x"}) {
    options.address = bad;
    EXPECT_EQ(HttpServer::Start(options, Echo).status().code(), absl::StatusCode::kInvalidArgument) << bad;
  }
}

}  // namespace
}  // namespace cairn::server

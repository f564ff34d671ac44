#include "client/remote/channel.h"

#include <grpcpp/support/client_interceptor.h>

#include <algorithm>
#include <chrono>
#include <random>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "client/remote/server_token.h"
#include "store/fault.h"
#include "wire/errors.h"

namespace cairn::client {
namespace {

constexpr int kMaxMessageBytes = 256 << 20;
constexpr std::chrono::milliseconds kLongestConnecting(500);

// Calls that only read may be made again; gRPC waits longer from one to the next, by a random share.
std::string ServiceConfig(int attempts) {
  if (attempts < 2) return "{}";
  return absl::StrFormat(
      R"({"methodConfig": [{"name": [{"service": "cairn.v1.Maps", "method": "ListMaps"},
                                     {"service": "cairn.v1.Maps", "method": "DescribeMap"},
                                     {"service": "cairn.v1.Admin", "method": "ListDeletedMaps"},
                                     {"service": "cairn.v1.Admin", "method": "OverviewMap"},
                                     {"service": "cairn.v1.Admin", "method": "VerifyMap"},
                                     {"service": "cairn.v1.Admin", "method": "ReadLog"},
                                     {"service": "cairn.v1.Sessions", "method": "ListSessions"},
                                     {"service": "cairn.v1.Status"},
                                     {"service": "cairn.v1.Localize"}],
          "retryPolicy": {"maxAttempts": %d, "initialBackoff": "0.1s", "maxBackoff": "1s", "backoffMultiplier": 2,
                          "retryableStatusCodes": ["UNAVAILABLE"]}}]})",
      attempts);
}

// Puts the token into every call, so that no call can forget it.
class TokenSender final : public grpc::experimental::Interceptor {
 public:
  explicit TokenSender(const ServerToken* token) : token_(*token) {}
  void Intercept(grpc::experimental::InterceptorBatchMethods* call) override {
    if (call->QueryInterceptionHookPoint(grpc::experimental::InterceptionHookPoints::PRE_SEND_INITIAL_METADATA)) {
      call->GetSendInitialMetadata()->insert({"authorization", absl::StrCat("Bearer ", token_.Text())});
    }
    call->Proceed();
  }

 private:
  const ServerToken& token_;
};

class TokenSenders final : public grpc::experimental::ClientInterceptorFactoryInterface {
 public:
  explicit TokenSenders(std::shared_ptr<const ServerToken> token) : token_(std::move(token)) {}
  grpc::experimental::Interceptor* CreateClientInterceptor(grpc::experimental::ClientRpcInfo* /*call*/) override {
    return new TokenSender(token_.get());
  }

 private:
  const std::shared_ptr<const ServerToken> token_;
};

// gRPC checks the name of the server, and speaks TLS 1.2 and 1.3 only.
std::shared_ptr<grpc::ChannelCredentials> CredentialsOf(const RemoteOptions& options) {
  if (!options.tls || absl::StartsWith(options.server, "unix:")) return grpc::InsecureChannelCredentials();
  return grpc::SslCredentials({options.tls->ca_pem, options.tls->key_pem, options.tls->certificate_pem});
}

// What the connection says of why it is none, with what to do.
std::string HintFor(const std::string& said, const RemoteOptions& options) {
  const std::string message = absl::AsciiStrToLower(said);
  if (absl::StrContains(message, "peer name")) {
    return "its certificate is for another name: name the server as its certificate does";
  }
  if (absl::StrContains(message, "certificate") || absl::StrContains(message, "ssl") ||
      absl::StrContains(message, "handshake failed")) {
    return "TLS failed: is its certificate of the CA given by --ca, does it ask for one of yours (--cert, --key), does "
           "it speak TLS at all?";
  }
  const bool closed = absl::StrContains(message, "socket closed") || absl::StrContains(message, "reset") ||
                      absl::StrContains(message, "broken pipe");
  // With TLS 1.3 a client is through before the server has looked for its certificate.
  if (closed && options.tls && options.tls->certificate_pem.empty()) {
    return "the server hung up: it may ask for a certificate of yours (--cert, --key)";
  }
  if (closed && options.tls) return "the server hung up: is your certificate (--cert) of the CA that it asks for?";
  if (closed) {
    return "is cairnd running there, and does it speak TLS (--ca, --tls)?";
  }
  if (absl::StrContains(message, "http1")) return "that is an HTTP port: cairnd answers clients at that of gRPC (7878)";
  return "is cairnd running there?";
}

// gRPC's own words have the two sizes: "... larger than max (1200060 vs. 1048576)".
std::string TooLargeText(const std::string& said, const std::string& server) {
  const std::size_t open = said.find('('), versus = said.find(" vs. ", open), close = said.find(')', versus);
  double size = 0.0, most = 0.0;
  if (open == std::string::npos || versus == std::string::npos || close == std::string::npos ||
      !absl::SimpleAtod(said.substr(open + 1, versus - open - 1), &size) ||
      !absl::SimpleAtod(said.substr(versus + 5, close - versus - 5), &most)) {
    return said;
  }
  constexpr double kMb = 1 << 20;
  if (most >= kMaxMessageBytes) {
    return absl::StrFormat("the answer of %s is too large: %.1f MB, and %.1f are taken", server, size / kMb,
                           most / kMb);
  }
  return absl::StrFormat(
      "%s takes messages of %.2f MB at most, and this one has %.2f: send a smaller or a compressed image, or its "
      "features (--send features); whoever runs the server can let it take more (cairnd --max-message-mb)",
      server, most / kMb, size / kMb);
}

}  // namespace

std::shared_ptr<grpc::Channel> NewChannel(const RemoteOptions& options) {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(kMaxMessageBytes);
  // The server packs nothing, and gRPC would unpack a message before it looks at its size.
  arguments.SetInt(GRPC_COMPRESSION_CHANNEL_ENABLED_ALGORITHMS_BITSET, 1 << GRPC_COMPRESS_NONE);
  arguments.SetServiceConfigJSON(ServiceConfig(options.attempts));
  arguments.SetUserAgentPrefix("cairn");
  // A server that is gone without a word is noticed.
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, 10000);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 5000);
  // A server that was restarted is found again within a second.
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
  // How long a connection may take to come about: with TLS over a slow link more than a moment.
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, 2000);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 1000);
  std::vector<std::unique_ptr<grpc::experimental::ClientInterceptorFactoryInterface>> senders;
  if (!options.token.empty()) {
    senders.push_back(std::make_unique<TokenSenders>(
        options.shown != nullptr ? options.shown : std::make_shared<ServerToken>(options)));
  }
  return grpc::experimental::CreateCustomChannelWithInterceptors(options.server, CredentialsOf(options), arguments,
                                                                 std::move(senders));
}

void SetDeadline(double deadline_s, grpc::ClientContext* context) {
  const auto time =
      std::chrono::duration_cast<std::chrono::system_clock::duration>(std::chrono::duration<double>(deadline_s));
  context->set_deadline(std::chrono::system_clock::now() + time);
}

std::chrono::milliseconds PauseBefore(int attempt) {
  thread_local std::minstd_rand random{std::random_device{}()};
  const double longest = 50.0 * static_cast<double>(1 << std::min(attempt, 4));
  return std::chrono::milliseconds(static_cast<int>(std::uniform_real_distribution<>(0.5, 1.0)(random) * longest));
}

void PauseAndConnect(int attempt, grpc::Channel* channel) {
  std::this_thread::sleep_for(PauseBefore(attempt));
  channel->WaitForConnected(std::chrono::system_clock::now() + kLongestConnecting);
}

bool IsOutage(const absl::Status& status) {
  const bool unreachable = absl::IsUnavailable(status) || absl::IsCancelled(status);
  return unreachable && store::FaultOf(status) == store::Fault::kNone;  // a map that is busy is no server that is away
}

bool Outage::Wait(const absl::Status& status) {
  const auto given_up = [&] { return options_.give_up && options_.give_up(); };
  if (given_up() || Clock::now() - begun_ > std::chrono::duration<double>(options_.outage_s)) return false;
  if (attempts_ == 0 && options_.on_outage) options_.on_outage(status);
  PauseAndConnect(attempts_++, &channel_);
  return !given_up();
}

bool Patience::Wait(const absl::Status& status) {
  const double after_s = wire::RetryAfterOf(status);
  if (!absl::IsResourceExhausted(status) || !(after_s > 0.0)) return false;
  // Those who were refused together do not come back together.
  thread_local std::minstd_rand random{std::random_device{}()};
  const double pause_s = 0.01 + after_s * std::uniform_real_distribution<>(1.0, 1.25)(random);
  const Clock::time_point now = Clock::now();
  const std::chrono::duration<double> waited = now - begun_;
  if (waited.count() + pause_s > options_.outage_s) return false;
  const auto until = now + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(pause_s));
  constexpr std::chrono::milliseconds kLook(50);
  while (Clock::now() < until) {
    if (options_.give_up && options_.give_up()) return false;
    std::this_thread::sleep_until(std::min(until, Clock::now() + kLook));
  }
  return true;
}

absl::Status FromGrpc(const grpc::Status& status, const RemoteOptions& options) {
  if (status.ok()) return absl::OkStatus();
  const std::string& server = options.server;
  if (status.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED && status.error_details().empty() &&
      absl::StrContains(status.error_message(), "larger than max")) {
    return absl::ResourceExhaustedError(TooLargeText(status.error_message(), server));
  }
  // What the server has to say of an error comes with details; what comes without is the connection's.
  if (status.error_code() == grpc::StatusCode::UNAVAILABLE && status.error_details().empty()) {
    return absl::UnavailableError(absl::StrCat("no answer from ", server, " (", status.error_message(),
                                               "): ", HintFor(status.error_message(), options)));
  }
  if (status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED && status.error_details().empty()) {
    return absl::DeadlineExceededError(absl::StrCat(server, " did not answer in time"));
  }
  return wire::StatusFrom(static_cast<int>(status.error_code()), status.error_message(), status.error_details());
}

}  // namespace cairn::client

#include "server/grpc/grpc_server.h"

#include <grpc/grpc.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "server/grpc/services.h"

namespace cairn::server {
namespace {

bool IsUnix(const std::string& address) { return absl::StartsWith(address, "unix:"); }

// gRPC speaks TLS 1.2 and 1.3 only, and of 1.2 the ciphers with forward secrecy and authenticated encryption.
std::shared_ptr<grpc::ServerCredentials> CredentialsOf(const GrpcServerOptions& options) {
  if (!options.tls || IsUnix(options.address)) return grpc::InsecureServerCredentials();
  grpc::SslServerCredentialsOptions tls(options.tls->client_ca_pem.empty()
                                            ? GRPC_SSL_DONT_REQUEST_CLIENT_CERTIFICATE
                                            : GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  tls.pem_key_cert_pairs.push_back({options.tls->key_pem, options.tls->certificates_pem});
  tls.pem_root_certs = options.tls->client_ca_pem;
  return grpc::SslServerCredentials(tls);
}

class Server final : public GrpcServer {
 public:
  explicit Server(const CallContext& context) : context_(context), services_(MakeServices(&context_)) {}
  ~Server() override { Stop(std::chrono::milliseconds(0)); }

  absl::Status Listen(const GrpcServerOptions& options) {
    grpc::EnableDefaultHealthCheckService(true);
    grpc::reflection::InitProtoReflectionServerBuilderPlugin();
    grpc::ResourceQuota quota("cairnd");
    quota.SetMaxThreads(options.max_threads);
    grpc::ServerBuilder builder;
    builder.SetResourceQuota(quota);
    builder.SetMaxReceiveMessageSize(static_cast<int>(options.max_message_bytes));
    // gRPC unpacks a message before it looks at its size, a thousandfold if the client likes: packed ones are refused.
    for (const auto packed : {GRPC_COMPRESS_DEFLATE, GRPC_COMPRESS_GZIP}) {
      builder.SetCompressionAlgorithmSupportStatus(packed, false);
    }
    // An image comes as a whole, without the client waiting for leave to send the rest of it.
    builder.AddChannelArgument(GRPC_ARG_HTTP2_STREAM_LOOKAHEAD_BYTES, 4 << 20);
    builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_FRAME_SIZE, 1 << 20);
    // Clients may ask whether the connection is alive while nothing is sent over it.
    builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, 5000);
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, 20000);
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 10000);
    // Two servers on one port would share its clients.
    builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
    builder.AddListeningPort(options.address, CredentialsOf(options), &port_);
    for (const auto& service : services_) builder.RegisterService(service.get());
    server_ = builder.BuildAndStart();
    if (server_ == nullptr) {
      return absl::UnavailableError(
          absl::StrCat("cannot listen on ", options.address, ": is it taken, or not an address of this machine?"));
    }
    if (IsUnix(options.address)) port_ = 0;
    return absl::OkStatus();
  }

  int port() const override { return port_; }

  void Stop(std::chrono::milliseconds grace) override {
    if (server_ == nullptr) return;
    server_->Shutdown(std::chrono::system_clock::now() + grace);
    server_->Wait();
    server_.reset();
  }

 private:
  const CallContext context_;
  const std::vector<std::unique_ptr<grpc::Service>> services_;
  std::unique_ptr<grpc::Server> server_;
  int port_ = 0;
};

}  // namespace

absl::StatusOr<std::unique_ptr<GrpcServer>> GrpcServer::Start(const GrpcServerOptions& options,
                                                              const CallContext& context) {
  // gRPC ends with the last that uses it, and waits then for a thread that may look for ten seconds whether a
  // connection takes the rest of a large answer (seen with 1.51): it lasts as long as the process.
  [[maybe_unused]] static const bool lasting = (grpc_init(), true);
  auto server = std::make_unique<Server>(context);
  CAIRN_RETURN_IF_ERROR(server->Listen(options));
  return server;
}

}  // namespace cairn::server

#include "server/daemon/daemon.h"

#include <algorithm>
#include <utility>

#include "absl/strings/match.h"
#include "server/daemon/addresses.h"

namespace cairn::server {
namespace {

// With the port that was given out.
std::string Bound(const std::string& address, int port) {
  if (absl::StartsWith(address, "unix:")) return address;
  return absl::StrCat(address.substr(0, address.rfind(':')), ":", port);
}

absl::Status CheckLoopback(const std::string& address) {
  if (IsLoopback(address)) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat("other machines reach ", address,
                   ", and nothing protects the maps there: listen on 127.0.0.1 and let them come through ssh or a "
                   "proxy that asks who they are, or say --without-protection if everyone who gets there may do "
                   "everything"));
}

ServerState StateOf(host::MapHost& maps) {
  ServerState state;
  for (const host::MapHost::OpenMap& map : maps.OpenMaps()) {
    state.open_maps.push_back({map.name, map.revision, map.bytes});
  }
  state.waiting = maps.waiting();
  const host::SessionTable::Counts sessions = maps.sessions();
  state.sessions = sessions.held;
  state.sessions_waiting = sessions.waiting;
  return state;
}

}  // namespace

absl::Status DaemonOptions::Validate() const {
  CAIRN_RETURN_IF_ERROR(maps.Validate());
  CAIRN_RETURN_IF_ERROR(CheckAddress(grpc.address));
  if (grpc.max_message_bytes < 1 << 16 || grpc.max_message_bytes > 1 << 30) {
    return absl::InvalidArgumentError("grpc: max_message_bytes must be 64 KB to 1 GB");
  }
  if (grpc.max_threads < 8) return absl::InvalidArgumentError("grpc: max_threads must be at least 8");
  if (http.max_connections < 1) return absl::InvalidArgumentError("http: max_connections must be positive");
  if (images.max_pixels < 1) return absl::InvalidArgumentError("images: max_pixels must be positive");
  if (!no_http) CAIRN_RETURN_IF_ERROR(CheckAddress(http.address));
  if (without_protection) return absl::OkStatus();
  CAIRN_RETURN_IF_ERROR(CheckLoopback(grpc.address));
  return no_http ? absl::OkStatus() : CheckLoopback(http.address);
}

absl::StatusOr<std::unique_ptr<Daemon>> Daemon::Start(const DaemonOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  auto daemon = std::unique_ptr<Daemon>(new Daemon);
  CAIRN_ASSIGN_OR_RETURN(daemon->maps_, host::MapHost::Open(options.maps));
  CAIRN_RETURN_IF_ERROR(daemon->Listen(options));
  return daemon;
}

absl::Status Daemon::Listen(const DaemonOptions& options) {
  metrics_ = std::make_unique<Metrics>([maps = maps_.get()] { return StateOf(*maps); });
  const CallContext context{maps_.get(), options.images, metrics_.get()};
  if (!options.no_http) {
    const HttpHooks hooks{[maps = maps_.get()] { return maps->Ready(); }, [this] { return metrics_->Text(); }};
    http_api_ = std::make_unique<HttpApi>(context, hooks);
    CAIRN_ASSIGN_OR_RETURN(http_, HttpServer::Start(options.http, [api = http_api_.get()](const HttpRequest& request) {
                             return api->Handle(request);
                           }));
    http_address_ = Bound(options.http.address, http_->port());
  }
  CAIRN_ASSIGN_OR_RETURN(grpc_, GrpcServer::Start(options.grpc, context));
  grpc_address_ = Bound(options.grpc.address, grpc_->port());
  return absl::OkStatus();
}

Daemon::~Daemon() { Stop(std::chrono::milliseconds(0)); }

void Daemon::Stop(std::chrono::milliseconds grace) {
  const auto until = std::chrono::steady_clock::now() + grace;
  if (grpc_ != nullptr) grpc_->Stop(grace);
  const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - std::chrono::steady_clock::now());
  if (http_ != nullptr) http_->Stop(std::max(left, std::chrono::milliseconds(0)));
}

}  // namespace cairn::server

#include "server/daemon/daemon.h"

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

}  // namespace

absl::Status DaemonOptions::Validate() const {
  CAIRN_RETURN_IF_ERROR(maps.Validate());
  CAIRN_RETURN_IF_ERROR(CheckAddress(grpc.address));
  if (grpc.max_message_bytes < 1 << 16 || grpc.max_message_bytes > 1 << 30) {
    return absl::InvalidArgumentError("grpc: max_message_bytes must be 64 KB to 1 GB");
  }
  if (grpc.max_threads < 8) return absl::InvalidArgumentError("grpc: max_threads must be at least 8");
  if (images.max_pixels < 1) return absl::InvalidArgumentError("images: max_pixels must be positive");
  if (!IsLoopback(grpc.address) && !without_protection) {
    return absl::FailedPreconditionError(
        absl::StrCat("other machines reach ", grpc.address,
                     ", and nothing protects the maps there: listen on 127.0.0.1 and let them come through ssh or a "
                     "proxy that asks who they are, or say --without-protection if everyone who gets there may do "
                     "everything"));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<Daemon>> Daemon::Start(const DaemonOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  auto daemon = std::unique_ptr<Daemon>(new Daemon);
  CAIRN_ASSIGN_OR_RETURN(daemon->maps_, host::MapHost::Open(options.maps));
  const CallContext context{daemon->maps_.get(), options.images};
  CAIRN_ASSIGN_OR_RETURN(daemon->grpc_, GrpcServer::Start(options.grpc, context));
  daemon->grpc_address_ = Bound(options.grpc.address, daemon->grpc_->port());
  return daemon;
}

Daemon::~Daemon() { Stop(std::chrono::milliseconds(0)); }

void Daemon::Stop(std::chrono::milliseconds grace) {
  if (grpc_ != nullptr) grpc_->Stop(grace);
}

}  // namespace cairn::server

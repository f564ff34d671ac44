// A server of a directory's maps in this process, on a loopback port that is free, and what asks it over gRPC.
#pragma once

#include <memory>
#include <string>
#include <utility>

#include "client/remote/remote_map_service.h"
#include "host/map_host.h"
#include "server/grpc/grpc_server.h"

namespace cairn::server {

class TestingServer {
 public:
  // `port` 0: one that is free.
  static absl::StatusOr<std::unique_ptr<TestingServer>> Start(const std::string& directory, GrpcServerOptions grpc = {},
                                                              int port = 0, const AccessOptions& access = {}) {
    auto server = std::make_unique<TestingServer>();
    host::MapHostOptions options;
    options.directory = directory;
    options.refresh_interval_s = 0.0;
    options.tracker.wait_for_matches = true;  // rendering takes longer than tracking
    options.tracker.refresh_interval_s = 0.01;
    CAIRN_ASSIGN_OR_RETURN(server->host, host::MapHost::Open(options));
    grpc.address = absl::StrCat("127.0.0.1:", port);
    CAIRN_ASSIGN_OR_RETURN(server->access, Access::Open(access));
    CallContext context{server->host.get(), {}, nullptr, server->access.get()};
    context.maps_folder = &server->host->directory();
    CAIRN_ASSIGN_OR_RETURN(server->grpc, GrpcServer::Start(grpc, context));
    return server;
  }

  client::RemoteOptions Remote() const {
    client::RemoteOptions options;
    options.server = absl::StrCat("127.0.0.1:", grpc->port());
    options.tracker.wait_for_matches = true;
    options.tracker.refresh_interval_s = 0.01;
    return options;
  }

  std::unique_ptr<Access> access;
  std::unique_ptr<host::MapHost> host;
  std::unique_ptr<GrpcServer> grpc;
};

}  // namespace cairn::server

// The map server: the maps of a directory behind gRPC and HTTP.
#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "base/status.h"
#include "host/map_host.h"
#include "server/access/access.h"
#include "server/grpc/grpc_server.h"
#include "server/http/http_api.h"
#include "server/http/http_server.h"
#include "server/metrics/metrics.h"
#include "server/tls/server_tls.h"

namespace cairn::server {

struct DaemonOptions {
  host::MapHostOptions maps;
  GrpcServerOptions grpc;
  HttpServerOptions http;
  bool no_http = false;
  ImageLimits images;
  std::string geopose_map;  // that the GeoPose Protocol asks; empty: those near the position that a request names
  TlsOptions tls;           // of gRPC and HTTP
  AccessOptions access;
  CorsOptions cors;
  // Listen also where other machines reach it, although TLS or tokens are missing.
  bool without_protection = false;

  absl::Status Validate() const;
  // Whether the directory of the maps, logs, certificates and tokens can be used. Changes nothing.
  absl::Status CheckFiles() const;
  // What is as it should not be, and yet no reason not to serve: a sentence each.
  std::vector<std::string> Warnings() const;
  // Who reaches it, and what stands between, for people.
  std::string ProtectionText() const;
};

class Daemon {
 public:
  // Listens when it returns.
  static absl::StatusOr<std::unique_ptr<Daemon>> Start(const DaemonOptions& options);
  ~Daemon();

  // "127.0.0.1:7878", with the port that it got.
  const std::string& grpc_address() const { return grpc_address_; }
  const std::string& http_address() const { return http_address_; }  // empty: none
  host::MapHost& maps() { return *maps_; }

  // For the owner to call about once a second.
  void Tick(std::chrono::steady_clock::time_point now);
  // In order: what is under way gets until `grace` is over.
  void Stop(std::chrono::milliseconds grace);

 private:
  Daemon() = default;
  absl::Status Listen(const DaemonOptions& options);

  std::unique_ptr<Access> access_;
  std::unique_ptr<host::MapHost> maps_;
  std::unique_ptr<Metrics> metrics_;
  std::unique_ptr<HttpApi> http_api_;
  std::unique_ptr<GrpcServer> grpc_;
  std::unique_ptr<HttpServer> http_;
  std::string grpc_address_;
  std::string http_address_;
  bool holds_maps_ = false;  // at the last Tick()
};

}  // namespace cairn::server

// What the server counts, as Prometheus reads it (docs/server.md lists the names).
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "server/rpc/calls.h"

namespace cairn::server {

// What is looked up when somebody asks for the metrics.
struct ServerState {
  struct Map {
    std::string name;
    Revision revision = 0;
    std::int64_t bytes = 0;      // in memory, roughly
    bool writing = false;        // sessions are extending it
    std::int64_t log_bytes = 0;  // its write-ahead log on the disk
  };
  std::vector<Map> open_maps;   // by name
  std::int64_t free_bytes = 0;  // on the disk of the maps
  std::vector<api::ActiveSession> active_sessions;
  std::int64_t lost_audit_lines = 0;
  std::int64_t waiting = 0;  // images that wait to be located
  int followers = 0;         // clients that keep a copy of a map
  int sessions = 0;
  int sessions_waiting = 0;  // for a client that was cut off
};

class Metrics : public CallObserver, public StatusSource {
 public:
  explicit Metrics(std::function<ServerState()> state);
  ~Metrics() override;

  void OnCall(absl::string_view call, absl::string_view reason, double seconds) override;
  void OnLocalized(const api::LocalizeAnswer& answer) override;
  void OnTracked(const api::TrackAnswer* answer) override;
  void OnSessionFrame(absl::string_view state, double seconds) override;
  void OnFramesDropped(std::int64_t count) override;

  api::ServerStatus Status() override;
  // In Prometheus' text format, version 0.0.4.
  std::string Text();

 private:
  struct Families;
  const std::function<ServerState()> state_;
  const std::unique_ptr<Families> families_;
  const std::chrono::steady_clock::time_point started_ = std::chrono::steady_clock::now();
};

}  // namespace cairn::server

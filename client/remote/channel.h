// The connection to a server, and how a call over it ends.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <memory>
#include <string>

#include "base/status.h"
#include "client/remote/remote_map_service.h"

namespace cairn::client {

std::shared_ptr<grpc::Channel> NewChannel(const RemoteOptions& options);

void SetDeadline(double deadline_s, grpc::ClientContext* context);

// Before connecting again: longer from one attempt to the next, by a random share, so that clients of a server that
// comes back do not all knock at once.
std::chrono::milliseconds PauseBefore(int attempt);
// That, and then until there is a connection, for half a second at most. Calls that fail at once do not make gRPC look
// after its connections: left alone it does so every five seconds only.
void PauseAndConnect(int attempt, grpc::Channel* channel);

// The connection failed, or the server stops: not an answer to what was asked.
bool IsOutage(const absl::Status& status);

// The wait for a server that has gone away, of one call.
class Outage {
 public:
  // Both must outlive it.
  Outage(const RemoteOptions& options, grpc::Channel* channel) : options_(options), channel_(*channel) {}

  // After a call that ended in an outage: pauses, longer from one to the next, and returns true: try again. False once
  // it has taken RemoteOptions::outage_s, or who waits gives up.
  bool Wait(const absl::Status& status);

 private:
  using Clock = std::chrono::steady_clock;
  const RemoteOptions& options_;
  grpc::Channel& channel_;
  const Clock::time_point begun_ = Clock::now();
  int attempts_ = 0;
};

// The patience with a server that refuses a call as this client asks too much, and says when to come again
// (wire::RetryAfterOf). Such a call was never begun: any may be made again, not only one that only reads.
class Patience {
 public:
  explicit Patience(const RemoteOptions& options) : options_(options) {}  // must outlive it

  // After such a refusal: waits as it says and a little longer, and returns true: try again. False for anything else,
  // if that would take it beyond RemoteOptions::outage_s in all, or who waits gives up.
  bool Wait(const absl::Status& status);

 private:
  using Clock = std::chrono::steady_clock;
  const RemoteOptions& options_;
  const Clock::time_point begun_ = Clock::now();
};

// `call`, again and again while it is refused so.
template <class Function>
absl::Status Patiently(const RemoteOptions& options, const Function& call) {
  Patience patience(options);
  absl::Status status = call();
  while (patience.Wait(status)) status = call();
  return status;
}

// With its fault, and for a server that cannot be reached with its name and what to do.
absl::Status FromGrpc(const grpc::Status& status, const RemoteOptions& options);

}  // namespace cairn::client

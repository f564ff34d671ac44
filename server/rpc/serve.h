// How every call is served, whichever way it came in: it gets an id by which answers and logs name it, who asks is
// found out and what they may do, nothing is thrown out of it, and somebody may watch.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "absl/strings/string_view.h"
#include "base/guarded.h"
#include "base/status.h"
#include "server/access/authorized_maps.h"
#include "server/rpc/calls.h"

namespace cairn::server {

struct Served {
  absl::Status status;
  std::string request_id;
};

// That of the client, if it is one (letters, digits, '.', '_', '-', at most 64 of them), or else one of this call
// alone.
std::string RequestIdOf(const Caller& caller);

// One call whose client is known and has not asked for too much, as long as it lives.
class AdmittedCall {
 public:
  // Unauthenticated, or ResourceExhausted.
  static absl::StatusOr<std::unique_ptr<AdmittedCall>> Begin(const CallContext& server, const Caller& caller,
                                                             const std::string& request_id);
  // Of this call, with the rights of its client.
  const CallContext& context() const { return context_; }
  const Client& client() const { return client_; }

 private:
  AdmittedCall(const CallContext& server, Client client, ClientLimits::Pass pass);

  const Client client_;
  const ClientLimits::Pass pass_;
  std::unique_ptr<AuthorizedMaps> maps_;
  CallContext context_;
};

// What came in a stream is counted for its client, and if that is too much, waits its time.
void CountReceived(const CallContext& context, std::int64_t bytes);

// Errors go to the log, all of it to who watches.
void Note(const CallContext& context, const Client& client, absl::string_view call, const Served& served,
          double seconds, std::int64_t received_bytes);

// As clients are told it: it names no folder of this machine.
absl::Status Told(const CallContext& server, const absl::Status& status);

// `function` gets the context of the call.
template <class Function>
Served Serve(const CallContext& server, const Caller& caller, absl::string_view call, Function&& function) {
  const auto start = std::chrono::steady_clock::now();
  Served served{absl::OkStatus(), RequestIdOf(caller)};
  std::atomic<std::int64_t> received = caller.bytes;
  Client client{.peer = caller.peer, .request_id = served.request_id};
  served.status = Guarded([&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<AdmittedCall> admitted,
                           AdmittedCall::Begin(server, caller, served.request_id));
    client = admitted->client();
    CallContext context = admitted->context();
    context.received = &received;
    return function(context);
  });
  served.status = Told(server, served.status);
  Note(server, client, call, served, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(),
       received);
  return served;
}

}  // namespace cairn::server

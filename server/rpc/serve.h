// How every call is served, whichever way it came in: nothing is thrown out of it, it gets an id by which answers and
// the log name it, and somebody may watch.
#pragma once

#include <chrono>
#include <string>
#include <utility>

#include "absl/strings/string_view.h"
#include "base/guarded.h"
#include "base/status.h"
#include "server/rpc/calls.h"

namespace cairn::server {

struct Served {
  absl::Status status;
  std::string request_id;
};

// Of one call alone, in this process.
std::string NewRequestId();

// Errors go to the log, all of it to who watches.
void Note(const CallContext& context, absl::string_view call, const Served& served, double seconds);

template <class Function>
Served Serve(const CallContext& context, absl::string_view call, Function&& function) {
  const auto start = std::chrono::steady_clock::now();
  Served served{absl::OkStatus(), NewRequestId()};
  served.status = Guarded(std::forward<Function>(function));
  Note(context, call, served, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  return served;
}

}  // namespace cairn::server

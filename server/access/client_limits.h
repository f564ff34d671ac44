// How much one client may ask for, so that there is something left for the others. A client is a token, or where none
// is asked for, an address.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "base/status.h"

namespace cairn::server {

struct ClientLimitOptions {
  int max_calls = 32;             // at the same time; each stream is one
  double requests_per_s = 200.0;  // on average over some seconds; streams count once
  double bytes_per_s = 50e6;      // likewise, of all that the client sends
  int max_clients = 10'000;       // whose use is remembered

  absl::Status Validate() const;
};

class ClientLimits {
 public:
  using Clock = std::chrono::steady_clock;

  explicit ClientLimits(const ClientLimitOptions& options) : options_(options) {}

  // One call under way, as long as it lives.
  class Pass {
   public:
    Pass() = default;
    ~Pass();
    Pass(Pass&& other) noexcept;
    Pass& operator=(Pass&& other) noexcept;

   private:
    friend class ClientLimits;
    Pass(ClientLimits* limits, std::string client) : limits_(limits), client_(std::move(client)) {}
    ClientLimits* limits_ = nullptr;
    std::string client_;
  };

  // ResourceExhausted, with the time after which it may be tried again (wire::RetryAfterOf), if it is too much.
  absl::StatusOr<Pass> Enter(const std::string& client, std::int64_t bytes, Clock::time_point now);

  // What came in a stream: the time until there is room for it. To wait that long holds up the client through the flow
  // control of the connection, and loses nothing.
  Clock::duration Charge(const std::string& client, std::int64_t bytes, Clock::time_point now);
  // Charges, and waits, unless Stop() is or was called.
  void ChargeAndWait(const std::string& client, std::int64_t bytes);
  void Stop();

  std::size_t clients() const;

 private:
  // What may be used at once, and what of it is there: seconds' worth of the rate; less than none was used ahead.
  struct Use {
    int calls = 0;
    double requests = 0.0;
    double bytes = 0.0;
    Clock::time_point filled{};
  };
  Use* Find(const std::string& client, Clock::time_point now);
  void Fill(Use* use, Clock::time_point now) const;
  void Leave(const std::string& client);

  const ClientLimitOptions options_;
  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable stopped_;
  bool stopping_ = false;
  std::map<std::string, Use> uses_;
};

}  // namespace cairn::server

#include "server/access/client_limits.h"

#include <algorithm>
#include <utility>

#include "wire/errors.h"

namespace cairn::server {
namespace {

// What a client has not used is kept for so long.
constexpr double kBurstS = 2.0;

double SecondsOf(ClientLimits::Clock::duration duration) { return std::chrono::duration<double>(duration).count(); }

}  // namespace

absl::Status ClientLimitOptions::Validate() const {
  if (max_calls < 1) return absl::InvalidArgumentError("limits: max_client_calls must be positive");
  if (!(requests_per_s >= 1.0)) return absl::InvalidArgumentError("limits: client_requests_per_s must be at least 1");
  if (!(bytes_per_s >= 1e5)) return absl::InvalidArgumentError("limits: client_mb_per_s must be at least 0.1");
  if (max_clients < 1) return absl::InvalidArgumentError("limits: max_clients must be positive");
  return absl::OkStatus();
}

ClientLimits::Pass::Pass(Pass&& other) noexcept
    : limits_(std::exchange(other.limits_, nullptr)), client_(std::move(other.client_)) {}

ClientLimits::Pass& ClientLimits::Pass::operator=(Pass&& other) noexcept {
  std::swap(limits_, other.limits_);
  std::swap(client_, other.client_);
  return *this;
}

ClientLimits::Pass::~Pass() {
  if (limits_ != nullptr) limits_->Leave(client_);
}

void ClientLimits::Fill(Use* use, Clock::time_point now) const {
  const double passed_s = std::max(0.0, SecondsOf(now - use->filled));
  use->filled = std::max(use->filled, now);
  use->requests = std::min(use->requests + passed_s * options_.requests_per_s, kBurstS * options_.requests_per_s);
  use->bytes = std::min(use->bytes + passed_s * options_.bytes_per_s, kBurstS * options_.bytes_per_s);
}

// Null: there are too many clients at the same time.
ClientLimits::Use* ClientLimits::Find(const std::string& client, Clock::time_point now) {
  const auto found = uses_.find(client);
  if (found != uses_.end()) {
    Fill(&found->second, now);
    return &found->second;
  }
  if (uses_.size() >= static_cast<std::size_t>(options_.max_clients)) {
    // Who has used nothing for a while is as good as new.
    for (auto at = uses_.begin(); at != uses_.end();) {
      Use& use = at->second;
      Fill(&use, now);
      const bool as_new = use.calls == 0 && use.requests >= kBurstS * options_.requests_per_s &&
                          use.bytes >= kBurstS * options_.bytes_per_s;
      at = as_new ? uses_.erase(at) : std::next(at);
    }
    if (uses_.size() >= static_cast<std::size_t>(options_.max_clients)) return nullptr;
  }
  Use& use = uses_[client];
  use.filled = now;
  use.requests = kBurstS * options_.requests_per_s;
  use.bytes = kBurstS * options_.bytes_per_s;
  return &use;
}

absl::StatusOr<ClientLimits::Pass> ClientLimits::Enter(const std::string& client, std::int64_t bytes,
                                                       Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  Use* const use = Find(client, now);
  if (use == nullptr) return wire::RetryLater("there are too many clients at the same time", kBurstS);
  if (use->calls >= options_.max_calls) {
    return wire::RetryLater(
        absl::StrCat("you have ", options_.max_calls, " calls under way already, as many as one client may"), 1.0);
  }
  if (use->requests < 1.0) {
    return wire::RetryLater(
        absl::StrCat("you ask more than ", options_.requests_per_s, " times a second: as often as one client may"),
        (1.0 - use->requests) / options_.requests_per_s);
  }
  // One that is larger than all that may come at once must be able to pass, too: it is paid for afterwards.
  if (use->bytes < std::min(static_cast<double>(bytes), kBurstS * options_.bytes_per_s)) {
    const double missing = std::min(static_cast<double>(bytes), kBurstS * options_.bytes_per_s) - use->bytes;
    return wire::RetryLater(
        absl::StrCat("you send more than ", options_.bytes_per_s / 1e6, " MB a second: as much as one client may"),
        missing / options_.bytes_per_s);
  }
  use->requests -= 1.0;
  use->bytes -= static_cast<double>(bytes);
  ++use->calls;
  return Pass(this, client);
}

void ClientLimits::Leave(const std::string& client) {
  const std::lock_guard lock(mutex_);
  const auto found = uses_.find(client);
  if (found != uses_.end()) --found->second.calls;
}

ClientLimits::Clock::duration ClientLimits::Charge(const std::string& client, std::int64_t bytes,
                                                   Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  Use* const use = Find(client, now);
  if (use == nullptr) return Clock::duration::zero();  // its call is one that has entered: it is there
  use->bytes -= static_cast<double>(bytes);
  return std::chrono::duration_cast<Clock::duration>(
      std::chrono::duration<double>(std::max(0.0, -use->bytes / options_.bytes_per_s)));
}

void ClientLimits::ChargeAndWait(const std::string& client, std::int64_t bytes) {
  const Clock::time_point now = Clock::now();
  const Clock::time_point until = now + Charge(client, bytes, now);
  if (until <= now) return;
  std::unique_lock lock(mutex_);
  stopped_.wait_until(lock, until, [&] { return stopping_; });
}

void ClientLimits::Stop() {
  const std::lock_guard lock(mutex_);
  stopping_ = true;
  stopped_.notify_all();
}

std::size_t ClientLimits::clients() const {
  const std::lock_guard lock(mutex_);
  return uses_.size();
}

}  // namespace cairn::server

#include "server/access/client_limits.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>
#include <vector>

#include "wire/errors.h"

namespace cairn::server {
namespace {

using Clock = ClientLimits::Clock;
using std::chrono::milliseconds;
using std::chrono::seconds;

ClientLimitOptions Options() {
  ClientLimitOptions options;
  options.max_calls = 2;
  options.requests_per_s = 10.0;  // 20 at once
  options.bytes_per_s = 1e6;      // 2 MB at once
  options.max_clients = 3;
  return options;
}

TEST(ClientLimits, CountCallsUnderWay) {
  ClientLimits limits(Options());
  const Clock::time_point now{seconds(1000)};
  auto first = limits.Enter("a", 0, now);
  {
    const auto second = limits.Enter("a", 0, now);
    EXPECT_TRUE(first.ok() && second.ok());
    const absl::Status third = limits.Enter("a", 0, now).status();
    EXPECT_EQ(third.code(), absl::StatusCode::kResourceExhausted);
    EXPECT_GT(wire::RetryAfterOf(third), 0.0);
    EXPECT_TRUE(limits.Enter("b", 0, now).ok()) << "another client is not concerned";
  }
  EXPECT_TRUE(limits.Enter("a", 0, now).ok());
}

TEST(ClientLimits, RequestsComeBackWithTime) {
  ClientLimits limits(Options());
  Clock::time_point now{seconds(1000)};
  for (int i = 0; i < 20; ++i) EXPECT_TRUE(limits.Enter("a", 0, now).ok()) << i;
  const absl::Status refused = limits.Enter("a", 0, now).status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_NEAR(wire::RetryAfterOf(refused), 0.1, 1e-9);
  now += milliseconds(101);
  EXPECT_TRUE(limits.Enter("a", 0, now).ok());
  EXPECT_FALSE(limits.Enter("a", 0, now).ok());
  now -= seconds(10);  // time does not give twice
  EXPECT_FALSE(limits.Enter("a", 0, now).ok());
}

TEST(ClientLimits, BytesComeBackWithTimeAndLargeRequestsPass) {
  ClientLimits limits(Options());
  Clock::time_point now{seconds(1000)};
  EXPECT_TRUE(limits.Enter("a", 1'500'000, now).ok());
  const absl::Status refused = limits.Enter("a", 1'000'000, now).status();
  EXPECT_NEAR(wire::RetryAfterOf(refused), 0.5, 1e-9);
  now += milliseconds(1501);
  EXPECT_TRUE(limits.Enter("a", 10'000'000, now).ok()) << "larger than what may come at once, paid for afterwards";
  now += seconds(7);
  EXPECT_FALSE(limits.Enter("a", 1, now).ok());
  now += seconds(3);
  EXPECT_TRUE(limits.Enter("a", 1, now).ok());
}

TEST(ClientLimits, StreamsAreHeldUpAndRefuseNothing) {
  ClientLimits limits(Options());
  Clock::time_point now{seconds(1000)};
  const auto pass = limits.Enter("a", 0, now);
  EXPECT_EQ(limits.Charge("a", 2'000'000, now), Clock::duration::zero());
  EXPECT_EQ(limits.Charge("a", 500'000, now), milliseconds(500));
  now += milliseconds(500);
  EXPECT_EQ(limits.Charge("a", 100'000, now), milliseconds(100));
  // Who waits goes on when the server stops.
  std::thread waiting([&] { limits.ChargeAndWait("a", std::int64_t{1} << 40); });
  limits.Stop();
  waiting.join();
}

TEST(ClientLimits, RememberSoManyClientsOnly) {
  ClientLimits limits(Options());
  Clock::time_point now{seconds(1000)};
  {
    std::vector<absl::StatusOr<ClientLimits::Pass>> passes;
    for (const char* client : {"a", "b", "c"}) passes.push_back(limits.Enter(client, 0, now));
    EXPECT_EQ(limits.Enter("d", 0, now).status().code(), absl::StatusCode::kResourceExhausted);
  }
  EXPECT_EQ(limits.Enter("d", 0, now).status().code(), absl::StatusCode::kResourceExhausted) << "what they used counts";
  now += seconds(1);
  EXPECT_TRUE(limits.Enter("d", 0, now).ok());
  EXPECT_EQ(limits.clients(), 1u);
}

TEST(ClientLimits, ErrorsOfOptions) {
  ClientLimitOptions options;
  EXPECT_TRUE(options.Validate().ok());
  options.max_calls = 0;
  EXPECT_FALSE(options.Validate().ok());
  options = {};
  options.bytes_per_s = std::nan("");
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace cairn::server

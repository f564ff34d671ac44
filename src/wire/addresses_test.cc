#include "wire/addresses.h"

#include <gtest/gtest.h>

namespace cairn::wire {
namespace {

TEST(Addresses, WhatOnlyThisMachineReaches) {
  for (const char* address : {"127.0.0.1:7878", "127.8.8.8:1", "localhost:0", "[::1]:7878", "unix:/run/cairnd"}) {
    EXPECT_TRUE(CheckAddress(address).ok()) << address;
    EXPECT_TRUE(IsLoopback(address)) << address;
  }
  for (const char* address : {"0.0.0.0:7878", "[::]:7878", "192.168.0.1:7878", "127.0.0.1.example.org:80",
                              "127.example.org:80", "localhost.example.org:80", "128.0.0.1:80"}) {
    EXPECT_TRUE(CheckAddress(address).ok()) << address;
    EXPECT_FALSE(IsLoopback(address)) << address;
  }
}

TEST(Addresses, WhatIsNone) {
  for (const char* address : {"", "7878", ":7878", "localhost", "localhost:", "localhost:x", "localhost:70000",
                              "localhost:-1", "::1:7878", "unix:"}) {
    EXPECT_EQ(CheckAddress(address).code(), absl::StatusCode::kInvalidArgument) << address;
  }
}

TEST(Addresses, AreCompletedByThePort) {
  EXPECT_EQ(WithPort("localhost"), "localhost:7878");
  EXPECT_EQ(WithPort("[::1]"), "[::1]:7878");
  for (const std::string address : {"localhost:1", "[::1]:1", "unix:/a/b", "unix:relative", ""}) {
    EXPECT_EQ(WithPort(address), address);
  }
}

}  // namespace
}  // namespace cairn::wire

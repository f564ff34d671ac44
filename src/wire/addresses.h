// Where a server listens.
#pragma once

#include <string>

#include "base/status.h"

namespace cairn::wire {

// "HOST:PORT", "[IPV6]:PORT" or "unix:/path". InvalidArgument for anything else.
absl::Status CheckAddress(const std::string& address);

inline constexpr int kDefaultPort = 7878;  // of gRPC

// The address, with kDefaultPort where it names none.
std::string WithPort(const std::string& address);

// Only this machine reaches it: a Unix socket, localhost, 127.0.0.0/8 or ::1. The address has been checked.
bool IsLoopback(const std::string& address);

}  // namespace cairn::wire

// Times of day for people.
#pragma once

#include <cstdint>
#include <ctime>
#include <string>

namespace cairn::cli {

// "2026-01-31 12:00:00 UTC", or "" for 0: not recorded.
inline std::string FormatUnixTime(std::int64_t unix_ns) {
  if (unix_ns == 0) return "";
  const std::time_t seconds = static_cast<std::time_t>(unix_ns / 1'000'000'000);
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  char text[40];
  std::strftime(text, sizeof(text), "%Y-%m-%d %H:%M:%S UTC", &utc);
  return text;
}

}  // namespace cairn::cli

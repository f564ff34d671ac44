#include "io/time_text.h"

#include <algorithm>
#include <cstdint>
#include <limits>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"

namespace cairn::io {
namespace {

absl::Status NotATime(absl::string_view text, absl::string_view unit) {
  return absl::InvalidArgumentError(absl::StrCat("\"", text, "\" is not a time in ", unit));
}

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

// The power of ten of nanoseconds that one of the unit is.
int PowerOf(TimeUnit unit) {
  switch (unit) {
    case TimeUnit::kMilliseconds:
      return 6;
    case TimeUnit::kMicroseconds:
      return 3;
    case TimeUnit::kNanoseconds:
    case TimeUnit::kFrames:
      return 0;
    case TimeUnit::kSeconds:
      break;
  }
  return 9;
}

}  // namespace

absl::string_view TimeUnitName(TimeUnit unit) {
  switch (unit) {
    case TimeUnit::kMilliseconds:
      return "milliseconds";
    case TimeUnit::kMicroseconds:
      return "microseconds";
    case TimeUnit::kNanoseconds:
      return "nanoseconds";
    case TimeUnit::kFrames:
      return "frame numbers";
    case TimeUnit::kSeconds:
      break;
  }
  return "seconds";
}

absl::StatusOr<TimeNs> ParseTime(absl::string_view text, TimeUnit unit) {
  absl::string_view rest = text;
  bool negative = false;
  if (!rest.empty() && (rest[0] == '-' || rest[0] == '+')) {
    negative = rest[0] == '-';
    rest.remove_prefix(1);
  }
  // All digits without the point, and the power of ten that the last one counts.
  std::string digits;
  int power = 0;
  bool point = false, any = false;
  std::size_t i = 0;
  for (; i < rest.size() && (IsDigit(rest[i]) || (rest[i] == '.' && !point)); ++i) {
    if (rest[i] == '.') {
      point = true;
      continue;
    }
    any = true;
    if (!digits.empty() || rest[i] != '0') digits.push_back(rest[i]);
    if (point) --power;
  }
  if (!any) return NotATime(text, TimeUnitName(unit));
  if (i < rest.size()) {
    int exponent = 0;
    absl::string_view tail = rest.substr(i + 1);
    if (!tail.empty() && tail[0] == '+') tail.remove_prefix(1);
    if ((rest[i] != 'e' && rest[i] != 'E') || tail.empty() || tail[0] == ' ' || !absl::SimpleAtoi(tail, &exponent) ||
        exponent < -1000 || exponent > 1000) {
      return NotATime(text, TimeUnitName(unit));
    }
    power += exponent;
  }
  power += PowerOf(unit);
  const int num_digits = static_cast<int>(digits.size());
  const int kept = power < 0 ? std::max(num_digits + power, 0) : num_digits;
  constexpr std::uint64_t kLimit = static_cast<std::uint64_t>(std::numeric_limits<TimeNs>::max()) / 10 - 1;
  std::uint64_t value = 0;
  const auto append = [&value](std::uint64_t digit) {
    if (value > kLimit) return false;
    value = value * 10 + digit;
    return true;
  };
  bool fits = true;
  for (int k = 0; k < kept && fits; ++k) fits = append(static_cast<std::uint64_t>(digits[k] - '0'));
  for (int k = 0; k < power && value > 0 && fits; ++k) fits = append(0);
  if (!fits) return NotATime(text, absl::StrCat(TimeUnitName(unit), " that fits into 64 bits of nanoseconds"));
  // The first digit cut off, if it is not beyond all digits.
  if (power < 0 && num_digits + power >= 0 && digits[num_digits + power] >= '5') ++value;
  return negative ? -static_cast<TimeNs>(value) : static_cast<TimeNs>(value);
}

absl::StatusOr<TimeNs> ParseNanoseconds(absl::string_view text) {
  TimeNs value = 0;
  if (text.empty() || text[0] == ' ' || text.back() == ' ' || !absl::SimpleAtoi(text, &value)) {
    return NotATime(text, "whole nanoseconds");
  }
  return value;
}

std::string FormatSeconds(TimeNs time_ns) {
  const bool negative = time_ns < 0;
  const std::uint64_t magnitude =
      negative ? 0 - static_cast<std::uint64_t>(time_ns) : static_cast<std::uint64_t>(time_ns);
  return absl::StrFormat("%s%d.%09d", negative ? "-" : "", magnitude / 1000000000u, magnitude % 1000000000u);
}

}  // namespace cairn::io

#include "text/bars.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace cairn::text {

bool TerminalTakesBlocks() {
  if (isatty(STDOUT_FILENO) == 0) return false;
  for (const char* name : {"LC_ALL", "LC_CTYPE", "LANG"}) {
    const char* value = std::getenv(name);
    if (value == nullptr || *value == '\0') continue;
    const std::string locale = absl::AsciiStrToLower(value);
    return absl::StrContains(locale, "utf-8") || absl::StrContains(locale, "utf8");
  }
  return false;
}

std::string Sparkline(const std::vector<std::int64_t>& values, bool blocks) {
  static constexpr const char* kBlocks[] = {" ", "▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"};
  static constexpr const char* kPlain[] = {" ", ".", ":", "-", "=", "+", "*", "#", "@"};
  constexpr double kLevels = 8.0;
  const std::int64_t most = values.empty() ? 0 : *std::max_element(values.begin(), values.end());
  std::string line;
  for (const std::int64_t value : values) {
    const int level =
        most <= 0 || value <= 0
            ? 0
            : std::max(1,
                       static_cast<int>(std::lround(kLevels * static_cast<double>(value) / static_cast<double>(most))));
    absl::StrAppend(&line, (blocks ? kBlocks : kPlain)[level]);
  }
  return line;
}

std::string Bar(std::int64_t value, std::int64_t most, int columns, bool blocks) {
  if (value <= 0 || most <= 0) return "";
  const int length = std::max(
      1, static_cast<int>(std::lround(1.0 * columns * static_cast<double>(value) / static_cast<double>(most))));
  std::string bar;
  for (int i = 0; i < length; ++i) absl::StrAppend(&bar, blocks ? "█" : "#");
  return bar;
}

}  // namespace cairn::text

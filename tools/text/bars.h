// Histograms as text: blocks on a terminal that takes them, plain letters elsewhere.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace cairn::text {

// Whether standard output is a terminal whose locale writes UTF-8.
bool TerminalTakesBlocks();

// One character per value, the higher the more: of "▁▂▃▄▅▆▇█", or " .:-=+*#" if not `blocks`. What is not 0 is never
// shown as nothing.
std::string Sparkline(const std::vector<std::int64_t>& values, bool blocks);

// A bar of at most `columns` columns for `value` of `most`.
std::string Bar(std::int64_t value, std::int64_t most, int columns, bool blocks);

}  // namespace cairn::text

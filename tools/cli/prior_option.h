// The options that say where a camera is thought to be.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <optional>
#include <string>

#include "api/localizer.h"
#include "base/status.h"

namespace cairn::cli {

struct PriorOptions {
  std::string pose;   // x y z qx qy qz qw
  std::string sigma;  // metres, or units of the map, and degrees
  std::uint32_t component = 0;
};
void AddPriorOptions(CLI::App* verb, PriorOptions* options);

// Nothing if none is given. InvalidArgument names the option.
absl::StatusOr<std::optional<api::PosePrior>> ReadPrior(const PriorOptions& options);

}  // namespace cairn::cli

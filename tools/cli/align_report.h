// What cairn align tells of an alignment.
#pragma once

#include <optional>
#include <string>

#include "api/map_alignment.h"
#include "cli/cli.h"
#include "eval/reference.h"

namespace cairn::cli {

struct AlignReport {
  std::string map;                             // as the user named it
  const eval::Reference* reference = nullptr;  // null: not aligned by poses
  bool positions_only = false;
  const api::AlignAnswer& answer;
};

nlohmann::ordered_json AlignReportAsJson(const AlignReport& report);
void PrintAlignReport(const AlignReport& report);

// {"latitude_deg", "longitude_deg", "height_m", "enu_from_world_xyzw"}; null: none.
nlohmann::ordered_json AnchorAsJson(const std::optional<map::GeoAnchor>& anchor);

}  // namespace cairn::cli

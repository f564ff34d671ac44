#include "cli/described_map.h"

#include <string>

#include "cli/align_report.h"

namespace cairn::cli {

nlohmann::ordered_json SummaryAsJson(const api::MapSummary& map) {
  if (!map.status.ok()) return {{"name", map.name}, {"error", std::string(map.status.message())}};
  return {{"name", map.name},           {"id", map.id},
          {"title", map.title},         {"revision", map.revision},
          {"keyframes", map.keyframes}, {"points", map.points},
          {"cameras", map.cameras},     {"components", map.components},
          {"sessions", map.sessions},   {"format_version", map.format_version},
          {"bytes", map.file_bytes},    {"open", map.open},
          {"writing", map.writing},     {"geo_anchor", AnchorAsJson(map.geo_anchor)}};
}

}  // namespace cairn::cli

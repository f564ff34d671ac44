#include "cli/findings.h"

namespace cairn::cli {

nlohmann::ordered_json FindingsAsJson(const std::vector<map::Finding>& findings) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const map::Finding& finding : findings) {
    json.push_back({{"table", finding.table}, {"id", finding.id}, {"message", finding.message}});
  }
  return json;
}

}  // namespace cairn::cli

#include "cli/cli.h"

#include <iostream>

#include "store/fault.h"

namespace cairn::cli {
namespace {

int ExitCodeOf(const absl::Status& status) {
  if (status.ok()) return kOk;
  if (store::IsDamaged(status)) return kDamagedMap;
  if (store::IsNewerVersion(status)) return kNewerVersion;
  return kFailure;
}

}  // namespace

int Fail(const std::string& verb, const absl::Status& status, bool json) {
  const int code = ExitCodeOf(status);
  if (json) {
    const absl::string_view fault = store::FaultName(store::FaultOf(status));
    PrintJson({{"error", std::string(status.message())}, {"fault", std::string(fault)}, {"exit_code", code}});
  } else {
    std::cerr << "cairn " << verb << ": " << status.message() << "\n";
  }
  return code;
}

int FailUsage(const std::string& verb, const std::string& message, bool json) {
  if (json) {
    PrintJson({{"error", message}, {"fault", "usage"}, {"exit_code", kUsage}});
  } else {
    std::cerr << "cairn" << (verb.empty() ? "" : " ") << verb << ": " << message << "\n";
  }
  return kUsage;
}

void AddFrameAndUnit(bool in_world, nlohmann::ordered_json* json) {
  (*json)["frame"] = in_world ? "world" : "map";
  (*json)["unit"] = in_world ? "m" : "map units";
}

void PrintJson(const nlohmann::ordered_json& json) {
  std::cout << json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) << "\n";
}

}  // namespace cairn::cli

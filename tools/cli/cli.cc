#include "cli/cli.h"

#include <iostream>

#include "absl/strings/ascii.h"
#include "absl/strings/str_split.h"
#include "cli/map_to_read.h"
#include "cli/usage_error.h"
#include "store/fault.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

int ExitCodeOf(const absl::Status& status) {
  if (status.ok()) return kOk;
  if (store::IsDamaged(status)) return kDamagedMap;
  if (store::IsNewerVersion(status)) return kNewerVersion;
  return kFailure;
}

// On standard error. Names in it cannot command a terminal.
void Tell(const std::string& verb, absl::string_view message) {
  std::string head = absl::StrCat("cairn", verb.empty() ? "" : " ", verb, ": "), told;
  for (const absl::string_view line : absl::StrSplit(message, '\n')) {
    absl::StrAppend(&told, text::WrappedOn(stderr, absl::StrCat(head, text::Shown(line))));
    head.clear();
  }
  std::cerr << told;
}

// What the store says is wrong with a map; of other errors their kind: "not_found", "invalid_argument".
std::string FaultOf(const absl::Status& status) {
  const store::Fault fault = store::FaultOf(status);
  if (fault != store::Fault::kNone) return std::string(store::FaultName(fault));
  return absl::AsciiStrToLower(absl::StatusCodeToString(status.code()));
}

}  // namespace

int Fail(const std::string& verb, const absl::Status& status, bool json) {
  const int code = ExitCodeOf(status);
  const std::string named = NamedAsServed(status.message());
  absl::string_view message = named;
  absl::ConsumePrefix(&message, absl::StrCat(verb, ": "));  // where it came from may have said so already
  if (status.GetPayload(kUsageMark)) return FailUsage(verb, std::string(message), json);
  if (json) {
    PrintJson({{"error", std::string(message)}, {"fault", FaultOf(status)}, {"exit_code", code}});
  } else {
    Tell(verb, message);
  }
  return code;
}

int FailUsage(const std::string& verb, const std::string& message, bool json) {
  if (json) {
    PrintJson({{"error", message}, {"fault", "usage"}, {"exit_code", kUsage}});
  } else {
    Tell(verb, message);
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

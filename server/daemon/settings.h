// The settings of cairnd, each under one name: an option of the command line (--memory-mb) and a key of cairnd.yaml
// (memory_mb).
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "base/status.h"
#include "server/daemon/daemon.h"

namespace cairn::server {

struct Setting {
  std::string key;
  std::string help;
  bool is_flag = false;  // true or false, and false unless given; on the command line without a value
  std::string standard;  // what it is unless it is set, as text
  // InvalidArgument, saying what it takes. Whether it fits the others, DaemonOptions::Validate() says.
  std::function<absl::Status(absl::string_view text)> set;
};

// All of them, writing to `options`, which must outlive them.
std::vector<Setting> SettingsOf(DaemonOptions* options);

// Takes over what the file says. Errors name file and line; unknown and repeated keys are errors.
absl::Status LoadSettings(const std::string& path, const std::vector<Setting>& settings);

}  // namespace cairn::server

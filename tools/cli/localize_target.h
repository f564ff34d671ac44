// What `cairn localize` asks: a map file in this process, or a map of a server.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "api/localizer.h"
#include "base/ids.h"
#include "base/status.h"
#include "cli/common_frame.h"
#include "cli/server_option.h"

namespace cairn::cli {

class LocalizeTarget : public api::Localizer {
 public:
  // On to what others have added to the map since, where that does not happen by itself; true if there was something.
  virtual absl::StatusOr<bool> Refresh() = 0;
  virtual Revision revision() const = 0;
  // As of the last Refresh().
  virtual const CommonFrame& frame() const = 0;
  // Of the map, as calibrated; as of the opening.
  virtual const std::vector<Camera>& cameras() const = 0;
};

// `server` empty: `map` is a file.
absl::StatusOr<std::unique_ptr<LocalizeTarget>> OpenLocalizeTarget(const ServerChoice& server, const std::string& map);

}  // namespace cairn::cli

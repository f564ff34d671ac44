// "Where is this photo?", asked of several maps.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "api/localize_across.h"
#include "base/status.h"
#include "cli/map_camera.h"
#include "cli/server_option.h"

namespace cairn::cli {

// The maps that are asked.
class AcrossTarget {
 public:
  virtual ~AcrossTarget() = default;
  // Of those that can be read; an error if none can.
  virtual absl::StatusOr<std::vector<CamerasOfMap>> Cameras() = 0;
  virtual absl::StatusOr<api::AcrossAnswer> Localize(const api::LocalizeQuery& query) = 0;
};

// Maps of a server (none: all that it has), or files.
absl::StatusOr<std::unique_ptr<AcrossTarget>> OpenAcrossTarget(const ServerChoice& server,
                                                               const std::vector<std::string>& maps);

// Says which of the maps the image is of, with the pose there. The exit code.
int TellAcross(const api::AcrossAnswer& across, const std::string& image, bool json);

}  // namespace cairn::cli

// "Where is this camera?" as the web asks it.
#pragma once

#include "base/status.h"
#include "server/http/message.h"
#include "server/rpc/calls.h"

namespace cairn::server {

// From a form with the parts `image` (a PNG or JPEG file), `camera` (server/http/camera_json.h; its size is the image's
// unless it is given) and perhaps `time_ns`; or from JSON, the message of cairn.v1 as it is. Without the map's name.
// InvalidArgument says what is wrong.
absl::StatusOr<v1::LocalizeImageRequest> ReadLocalizeRequest(const HttpRequest& http);

// Likewise, for several maps: a form may have the part `maps`, their names with commas between; without it all are
// meant.
absl::StatusOr<v1::LocalizeInMapsRequest> ReadLocalizeInMapsRequest(const HttpRequest& http);

}  // namespace cairn::server

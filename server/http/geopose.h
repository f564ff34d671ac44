// The GeoPose Protocol of the Open AR Cloud, version 2 (https://github.com/OpenArCloud/oscp-geopose-protocol, README
// "version 2 candidate 1"): where on the earth is the camera that took this image?
//
// The answer is a pose in the sense of OGC GeoPose 1.0 (map/geo_pose.h): latitude, longitude, height above the
// ellipsoid, and the rotation of the camera's axes (x forward, y left, z up) to east, north, up at its position. It is
// computed against the maps that have a geographic anchor; near a prior position, if the request has one.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "api/map_service.h"
#include "base/status.h"
#include "map/geo_pose.h"
#include "server/http/message.h"
#include "server/rpc/calls.h"

namespace cairn::server {

inline constexpr absl::string_view kGeoPoseMediaType = "application/vnd.oscp+json; version=2.0";

// What a request asks.
struct GeoPoseRequest {
  std::string id;
  std::int64_t timestamp_ms = 0;  // since 1970
  // Of the newest camera reading by its timestamp (of those that have the same, or none, the last).
  v1::Image image;
  Camera camera;  // of that image
  // From the newest of its prior poses, or else its geolocation; with how far off it may be.
  std::optional<GeoPosition> prior;
  double prior_accuracy_m = 0.0;
};

// How sure a geopose is, as the protocol says it: means over the three axes.
struct GeoPoseAccuracy {
  double position_m = 0.0;
  double orientation_deg = 0.0;
};

// OK if a client that accepts `accept` (the header) takes version 2; InvalidArgument says what to send.
absl::Status CheckGeoPoseVersion(absl::string_view accept);

// InvalidArgument says what is wrong. The image is not decoded yet.
absl::StatusOr<GeoPoseRequest> ReadGeoPoseRequest(const std::string& body);

// Of one that is located, in a component that is aligned.
GeoPoseAccuracy AccuracyOf(const api::LocatedPose& located);

// The names of the maps to ask, nearest first: those with an anchor, of which the prior position must be near. NotFound
// if there is none.
absl::StatusOr<std::vector<std::string>> MapsNear(const std::vector<api::MapSummary>& maps,
                                                  const GeoPoseRequest& request);

// The whole exchange: 200 with the answer, 400 for what makes no sense, 404 where the camera was not found. `only`: the
// map that is asked; empty: those near the position that the request names.
HttpResponse AnswerGeoPose(const CallContext& server, const Caller& caller, const HttpRequest& http,
                           absl::string_view only = "");

}  // namespace cairn::server

// Aligns a component to the world by what somebody has measured: positions of some of its points or cameras, distances
// between them, the direction of gravity. Closed forms over a few numbers that a person has read off; recordings with
// poses are aligned by engine::AlignMap.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "base/status.h"
#include "engine/live_map.h"
#include "map/snapshot.h"

namespace cairn::care {

// The point that a keyframe sees nearest to a pixel of its undistorted image.
struct SeenAt {
  KeyframeId keyframe;
  Vector2d pixel = Vector2d::Zero();
};
// A point, the camera of a keyframe, or what is seen at a pixel.
using Landmark = std::variant<PointId, KeyframeId, SeenAt>;

struct KnownPosition {
  Landmark of;
  Vector3d world_m = Vector3d::Zero();
};
struct KnownDistance {
  Landmark from, to;
  double metres = 0.0;
};

struct KnownPlaces {
  // Three at least, not on a line; or none, and then:
  std::vector<KnownPosition> positions;
  std::vector<KnownDistance> distances;  // give the scale, by the mean of what each says
  // Give which way is up, which becomes the world's z axis: gravity in the frame of the component (of the world, if it
  // is aligned), or against where the cameras' images are upright on average.
  std::optional<Vector3d> gravity;
  bool upright_cameras = false;
  bool overwrite = false;  // an alignment that is there: scaled, turned, or replaced
  bool force = false;      // although positions or distances contradict each other

  absl::Status Validate() const;
};

struct KnownAlignment {
  Revision revision = 0;
  ComponentId component;
  Sim3 world_from_component;
  std::vector<double> errors_m;  // per position, or distance: how far it is off then
  double rmse_m = 0.0;
  double scale_sigma = 0.0;         // share of the scale; 0: nothing is left over to tell
  double rotation_sigma_rad = 0.0;  // of positions
};

// Durable on return; after an error the map is as it was. NotFound for a landmark that there is not, AlreadyExists for
// what would have to be overwritten, FailedPrecondition for what leaves something open or contradicts itself,
// InvalidArgument for landmarks of several components.
absl::StatusOr<KnownAlignment> AlignByKnownPlaces(const std::string& map, const KnownPlaces& known,
                                                  engine::LiveMap& live);

// Of one landmark: "point 12", "keyframe 3", "pixel 3 320.5 240"; takes its words from the front of `words`.
absl::StatusOr<Landmark> TakeLandmark(std::vector<std::string>* words);

}  // namespace cairn::care

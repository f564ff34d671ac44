// Giving a map its place in the world and on the earth: what is asked for, and what came of it.
//
// Frame "world" is where the aligned components of a map lie together, in metres; the geographic anchor says where its
// origin is on the earth (WGS 84) and how it is turned against east, north, up there.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "api/known_places.h"
#include "base/ids.h"
#include "base/status.h"
#include "geometry/geodesy.h"
#include "geometry/pose_alignment.h"
#include "geometry/stamped_pose.h"
#include "map/entities.h"

namespace cairn::api {

// Aligns a component to the world by poses of the camera (or of a body that it is fixed to) at the times of keyframes.
struct ReferencePoses {
  std::vector<StampedPose> poses;
  PoseAlignmentOptions solver;
};

// Where keyframes were on the earth, at least three of them that are not on a line: a GNSS track, surveyed places.
//  - a component that is aligned: the map gets its anchor by them;
//  - one that is not, while the map has an anchor: it is aligned to the world by that;
//  - one that is not, and nothing of the map is: both; world is then east, north, up at the first position.
struct GeoPositions {
  struct At {
    KeyframeId keyframe;  // or, if none, the nearest one of the component in time:
    TimeNs time_ns = 0;
    GeoPosition position;
  };
  std::vector<At> positions;
};

// The map forgets where it is on the earth.
struct NoGeoAnchor {};

struct AlignRequest {
  // A GeoAnchor is set as it is: of a map of which something is aligned.
  std::variant<ReferencePoses, GeoPositions, map::GeoAnchor, NoGeoAnchor, KnownPlaces> by;
  std::string source;      // how messages name the reference: the name of its file
  ComponentId component;   // none: the one with most keyframes that have a reference
  SessionId session;       // only its keyframes; none: all
  double max_dt_s = 0.02;  // largest difference in time of keyframe and reference
  bool overwrite = false;  // an alignment (or anchor) that is there
  bool force = false;      // although the reference does not fit well (docs/alignment.md says what it overrides)

  absl::Status Validate() const;
};

// How a component was aligned to its reference.
struct ComponentAlignment {
  ComponentId component;
  Sim3 world_from_component;  // as it is now
  std::int64_t keyframes = 0;
  std::int64_t with_reference = 0;
  std::int64_t fitting = 0;       // of these
  std::vector<double> misfits_s;  // times of the others
  double rmse_fitting_m = 0.0;    // of the positions ...
  double rmse_all_m = 0.0;
  // Standard deviations, about the worst axis. Of KnownPlaces 0 where nothing is left over to tell: of a single
  // distance (scale), of gravity and distances (rotation).
  double scale_sigma = 0.0;
  double rotation_sigma_rad = 0.0;
  double position_sigma_m = 0.0;  // of the middle of the keyframes
  // Of ReferencePoses: the noise that was found, and what its orientations are (kind, camera_from_body, turned_rad,
  // difference_rad).
  double noise_position_m = 0.0;
  double noise_rotation_rad = 0.0;
  OrientationAgreement orientations;
  bool orientations_used = false;
  double camera_in_body_m = 0.0;  // of a body: how far the camera sits from its centre
  double camera_in_body_sigma_m = 0.0;
  std::vector<double> errors_m;   // of KnownPlaces, per position or distance: how far it is off then
  std::optional<double> moved_m;  // by which its keyframes moved (median), if it was aligned before
  struct Other {
    ComponentId component;
    std::int64_t keyframes = 0;
    std::int64_t with_reference = 0;
    bool aligned = false;
  };
  std::vector<Other> others;  // components that remain as they were
};

struct AlignAnswer {
  Revision revision = 0;                        // that it led to
  std::optional<ComponentAlignment> component;  // none: no reference was compared with keyframes
  std::optional<map::GeoAnchor> geo_anchor;     // that the map has now
  bool geo_anchor_changed = false;
};

}  // namespace cairn::api

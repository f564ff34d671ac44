// What a map is made of. Entities refer to each other by id; each is a value that never changes once it is in a
// Snapshot. Every keyframe is in one component; frame "map" is that component's own: its scale and origin are arbitrary
// until the component is aligned (Component::world_from_component). Positions of different components mean nothing to
// each other.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/ids.h"
#include "base/status.h"
#include "base/time.h"
#include "geometry/camera.h"
#include "geometry/lens_correction.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"
#include "image/feature.h"
#include "map/feature_cache.h"

namespace cairn::map {

struct MapCamera {
  CameraId id;
  std::string name;
  Camera model;     // as calibrated, of the raw images
  Pinhole pinhole;  // of the undistorted images, in which all keypoints are given
  // What a session found that the calibration leaves over in undistorted images; keypoints are corrected by it, so that
  // `pinhole` is right for them (map/lens.h).
  std::optional<LensCorrection> lens = std::nullopt;
  bool operator==(const MapCamera&) const = default;
};

// A loop that was closed: the camera was back where it had been, and the map between was corrected.
struct ClosedLoop {
  KeyframeId keyframe;  // back there; like the other it may have left the map since
  TimeNs keyframe_time_ns = 0;
  KeyframeId loop_keyframe;  // that had seen the place before
  TimeNs loop_time_ns = 0;
  int matches = 0;        // that agree on the similarity between the two
  double scale = 1.0;     // lengths around `keyframe` over those around `loop_keyframe`, before: the drift
  double shift = 0.0;     // by which the camera was moved, map units ...
  double turn_rad = 0.0;  // ... and turned
  double way = 0.0;       // length of the path between, map units; 0: not known
  bool operator==(const ClosedLoop&) const = default;
};

// Which of its two trajectories a session reported (Lee and Civera, RA-L 2019, Sec. V-E).
struct ReportedTrajectory {
  bool refined = true;  // by the feature module; false: the direct module's
  int keyframes = 0;    // inserted by the session ...
  int collinear = 0;    // ... and of these, with collinear covisibility links
  std::string reason;   // for people
  bool operator==(const ReportedTrajectory&) const = default;
};

// How a component became part of another: overlap was proven, and its keyframes and points moved there.
struct ComponentJoin {
  ComponentId into;
  Sim3 into_from_component;  // that moved them
  // The keyframe of the component that proved it, and the one of `into` that it was matched with; like loops', they may
  // have left the map since.
  KeyframeId keyframe;
  KeyframeId into_keyframe;
  TimeNs keyframe_time_ns = 0;
  int matches = 0;                  // that agree on the similarity between the two
  int keyframes_agreeing = 0;       // keyframes that come to the same similarity by themselves ...
  int keyframes_checked = 0;        // ... of so many
  Revision revision = 0;            // of the change that joined them
  std::int64_t joined_unix_ns = 0;  // wall clock; 0 in deterministic runs
  bool operator==(const ComponentJoin& other) const;
};

// A part of the map with a frame of its own. It begins where a session does not know where it is, and lasts until
// overlap with another component is proven; then it is kept as history. Ids are never used twice.
struct Component {
  ComponentId id;
  SessionId session;                                        // that began it
  std::optional<Sim3> world_from_component = std::nullopt;  // none: not aligned
  std::optional<ComponentJoin> joined = std::nullopt;       // its keyframes are in another component now
  bool operator==(const Component& other) const;
};

// Where the world frame lies on the earth (WGS 84).
struct GeoAnchor {
  double latitude_deg = 0.0;
  double longitude_deg = 0.0;
  double height_m = 0.0;                                 // above the ellipsoid
  Quaterniond enu_from_world = Quaterniond::Identity();  // to east, north, up at that point
  absl::Status Validate() const;
};

// What a session was asked to do ...
enum class SessionPolicy { kCreate, kExtend };
// ... and how it came out. kApart: it never found itself in what was there before, and is a component of its own.
enum class SessionResult { kUnknown, kCreated, kLocated, kApart };
const char* SessionPolicyName(SessionPolicy policy);
const char* SessionResultName(SessionResult result);

// One run over a camera stream that added to the map.
struct Session {
  SessionId id;
  CameraId camera;
  std::string source;  // the sequence's name, not its path
  std::string software_version;
  std::string settings_json;  // every option that differs from the software's defaults, and the seed
  TimeNs first_ns = 0;        // of the images
  TimeNs last_ns = 0;
  std::int64_t started_unix_ns = 0;  // wall clock; 0 in deterministic runs
  std::int64_t ended_unix_ns = 0;
  bool complete = false;  // false: the session is running, or was cut off
  bool removed = false;   // its keyframes were taken out of the map; kept for the history
  SessionPolicy policy = SessionPolicy::kCreate;
  SessionResult result = SessionResult::kUnknown;  // of a complete session
  std::vector<ComponentId> components;             // that it has touched, ascending
  std::vector<ClosedLoop> loops;                   // in order
  std::optional<ReportedTrajectory> trajectory;    // of a complete session of images without given poses
  bool operator==(const Session&) const = default;
};

struct CovisibilityEdge {
  KeyframeId keyframe;
  int shared_points = 0;
  bool operator==(const CovisibilityEdge&) const = default;
};

struct Keyframe {
  KeyframeId id;
  SessionId session;
  CameraId camera;
  ComponentId component;
  TimeNs time_ns = 0;
  std::int64_t frame_index = 0;     // in its session's sequence
  SE3 camera_from_map;              // refined by the feature module
  SE3 camera_from_direct;           // as the direct module left it, in the odometry's own world
  std::int64_t direct_segment = 0;  // which start of the odometry that world belongs to; -1: poses were given
  FeatureHandle features;
  std::vector<PointId> points;              // per feature: the point it observes, or none
  KeyframeId parent;                        // in the spanning tree; none at its root
  std::vector<KeyframeId> children;         // ascending; the inverse of `parent`
  std::vector<CovisibilityEdge> covisible;  // most shared points first, then by id; symmetric

  Vector3d CenterInMap() const { return camera_from_map.Inverse().translation(); }
  // As *features: of a map that was loaded with them.
  const std::vector<image::Keypoint>& keypoints() const { return features->features.keypoints; }
  const std::vector<image::Descriptor>& descriptors() const { return features->features.descriptors; }
};

struct Observation {
  KeyframeId keyframe;
  std::uint32_t feature = 0;  // index into the keyframe's features
  auto operator<=>(const Observation&) const = default;
};

struct MapPoint {
  PointId id;
  Vector3d position = Vector3d::Zero();   // in the map frame
  std::vector<Observation> observations;  // ascending by keyframe; at most one per keyframe
  int times_visible = 1;                  // how often it was expected in a keyframe, and how often found there
  int times_found = 1;

  // Derived from the observations by map::Edit; kept here because matching reads them all the time.
  Observation reference;  // the observation closest to all others; gives the descriptor
  image::Descriptor descriptor{};
  Eigen::Vector3f mean_view_direction = Eigen::Vector3f::Zero();  // unit, from the cameras to the point
  // How large a pixel of the pyramid level of the reference observation is at the point, map units: any camera finds
  // the point at the level whose pixels are as large there (map/viewing.h).
  float pixel_size = 0.0f;
};

// What belongs to the map as a whole.
struct MapInfo {
  std::string id;  // 32 hex digits, fixed at creation
  std::string name;
  std::string software_version;       // that created it
  std::int64_t created_unix_ns = 0;   // 0 in deterministic runs
  image::OrbParameters orb;           // of every keyframe
  std::uint64_t vocabulary_hash = 0;  // 0: none
  std::optional<GeoAnchor> geo_anchor;
};

}  // namespace cairn::map

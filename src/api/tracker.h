// A pose for every image of a stream, in a map that is not touched, asked the same way of a map file in this process or
// of a daemon. A tracker finds itself, follows the camera, carries it on where the map does not reach, and finds itself
// again after a loss.
#pragma once

#include <cstdint>
#include <functional>
#include <opencv2/core.hpp>
#include <string>

#include "base/ids.h"
#include "base/status.h"
#include "base/time.h"
#include "geometry/se3.h"

namespace cairn::api {

struct TrackFrame {
  cv::Mat image;            // CV_8UC1, raw as the camera gives it, of the size of the tracker's camera
  TimeNs time_ns = 0;       // later than the frame's before
  double exposure_s = 0.0;  // 0: unknown
  // Asked between the steps of looking for a lost camera, which take long; true: the answer is kLost. May be empty.
  std::function<bool()> out_of_time = {};
};

enum class TrackState {
  kLocated,  // found in the map by this image, not by following the one before
  kTracked,  // followed, and matched against the map
  kCarried,  // followed from where the map was last matched: the covariance grows until it is again
  kLost,     // no pose
};
const char* TrackStateName(TrackState state);

struct TrackAnswer {
  TimeNs time_ns = 0;  // of the frame
  TrackState state = TrackState::kLost;
  std::string reason;  // of kLost and kCarried, for people

  // The pose, unless the state is kLost.
  SE3 map_from_camera;
  // The component in whose frame the pose is; positions of different components mean nothing to each other.
  ComponentId component;
  // The pose in the world frame; the same as map_from_camera while the component is not aligned.
  SE3 world_from_camera;
  double world_per_map = 1.0;
  bool world_is_metric = false;
  // Of (translation, rotation) as a left increment of map_from_camera, in map units and radians.
  Matrix6d covariance = Matrix6d::Zero();

  std::string map_id;
  Revision revision = 0;  // of the map that the pose is from
  TimeNs matched_ns = 0;  // time of the last frame that was matched against the map; 0: none yet
  int inliers = 0;        // points of the map matched in that frame
  // Where the frames until now contradict the camera that the tracker was opened with: what its focal length should be
  // multiplied by; the covariance covers it. 1: they do not.
  double focal_factor = 1.0;
  std::string note;  // what keeps the tracker from following the map (removed, damaged, no server); it goes on without
  bool map_damaged = false;  // that is what `note` says: poses come from what could be read of it
  // To who changes the map; a file is always within reach.
  bool connected = true;
  double map_age_s = 0.0;  // since what the tracker has of the map was the newest for certain; 0 for a file
  double track_ms = 0.0;   // time that the call took
};

// One interface, two implementations: a map file in this process, and a daemon. Not for several threads at once.
class Tracker {
 public:
  virtual ~Tracker() = default;

  // A loss is an answer, not an error. Errors: InvalidArgument (bad image, time that does not grow; nothing changes),
  // Unavailable (no server), DataLoss.
  virtual absl::StatusOr<TrackAnswer> Track(const TrackFrame& frame) = 0;
};

}  // namespace cairn::api

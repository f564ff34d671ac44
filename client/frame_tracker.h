// What the two ways of tracking share (client/local_tracker.h): the map as they see it, and what comes of a frame.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "api/tracker.h"
#include "client/anchor.h"
#include "client/calibration_evidence.h"
#include "client/local_tracker_options.h"
#include "client/map_matcher.h"
#include "client/map_watch.h"

namespace cairn::client {

// Of one frame.
struct TrackStep {
  api::TrackState state = api::TrackState::kLost;
  std::string reason;  // of kLost and kCarried
  ComponentId component;
  SE3 map_from_camera;
  Matrix6d covariance = Matrix6d::Zero();
};

struct TrackerContext {
  LocalTrackerOptions options;
  Pinhole pinhole;
  std::shared_ptr<const MapMatcher> matcher;
  std::unique_ptr<MapWatch> watch;
  std::shared_ptr<const tracking::MapView> view;     // that the poses are in
  std::shared_ptr<const tracking::MapView> retired;  // goes to the watch with the next job
  std::function<bool()> out_of_time;                 // of the call under way; may be empty
  CalibrationEvidence calibration;                   // by all images that were matched

  // Nothing if there is time left, else the reason of a loss.
  std::optional<std::string> OutOfTime() const {
    if (!out_of_time || !out_of_time()) return std::nullopt;
    return "the time of the call was up before the whole map was searched";
  }
};

// So long after a loss the camera is looked for around where it was.
inline constexpr double kNearbyS = 1.0;

// When a lost camera is looked for: at once, and the longer it is lost the more rarely.
class LostClock {
 public:
  void Found() { since_ns_.reset(); }
  // Of a frame without a pose; true if it should be looked for.
  bool Lost(TimeNs time_ns);

 private:
  static constexpr double kEvery = 0.2;       // searches come this share of the time since the loss apart ...
  static constexpr double kMostApartS = 1.0;  // ... but no more than so long
  std::optional<TimeNs> since_ns_;
  TimeNs next_ns_ = 0;
};

// The anchor in another revision of the map, with its covariance; nothing if what it was matched with has left the map.
std::optional<Anchor> MoveAnchor(const Anchor& anchor, const map::Snapshot& before, const map::Snapshot& after,
                                 double* unit_ratio);

class FrameTracker {
 public:
  virtual ~FrameTracker() = default;
  virtual absl::StatusOr<TrackStep> Track(const direct::Frame& frame) = 0;
  // The last frame that was matched; null: none yet.
  virtual const Anchor* anchor() const = 0;
  virtual const absl::Status& following() const = 0;
};

std::unique_ptr<FrameTracker> MakeSemiDirectTracker(TrackerContext* context);
std::unique_ptr<FrameTracker> MakeFeatureTracker(TrackerContext* context);

}  // namespace cairn::client

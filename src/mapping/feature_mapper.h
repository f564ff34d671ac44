// The feature module: takes the packets of the direct module in temporal order (mapping/packet_queue.h), refines the
// pose of each keyframe against the map, inserts the useful ones and keeps the map around them accurate and free of
// clutter. Lee and Civera, "Loosely-Coupled Semi-Direct Monocular SLAM" (RA-L 2019), Sec. V, with the local mapping of
// Mur-Artal, Montiel and Tardos, "ORB-SLAM" (T-RO 2015). Loop closing is a matter of its own.
//
// It works on map::Edit over the newest Snapshot and hands each change as one Delta to a commit function, which applies
// and stores it. Algorithms own no threads: call everything from the one mapping thread. Deterministic.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <unordered_map>
#include <vector>

#include "base/status.h"
#include "direct/packet.h"
#include "map/edit.h"
#include "mapping/feature_mapper_options.h"
#include "mapping/keyframe_trajectory.h"
#include "place/vocabulary.h"
#include "tracking/place_index.h"

namespace cairn::mapping {

// Where the time of one packet went, in milliseconds of the thread's processor time; 0 for what did not run.
struct StageTimes {
  double extract_ms = 0.0;
  double track_ms = 0.0;       // local map, matching, motion-only bundle adjustment
  double relocate_ms = 0.0;    // the search for the map after a loss
  double new_points_ms = 0.0;  // insertion and triangulation
  double fuse_ms = 0.0;
  double adjust_ms = 0.0;  // local bundle adjustment
  double cull_ms = 0.0;
  double commit_ms = 0.0;
  double cpu_ms = 0.0;    // all of it
  double total_ms = 0.0;  // by the clock
};

// What became of one packet.
struct KeyframeReport {
  std::int64_t direct_keyframe = 0;
  TimeNs time_ns = 0;
  FeatureState state = FeatureState::kInitializing;
  int features = 0;
  int depths = 0;               // features with a depth from the direct module
  int matches = 0;              // with points of the map, by projection
  int inliers = 0;              // after motion-only bundle adjustment
  bool located = false;         // the pose is known in the map
  SE3 map_from_camera;          // if located, right after this packet
  double map_per_direct = 1.0;  // relative scale around this keyframe
  bool inserted = false;
  KeyframeId keyframe;     // if inserted
  bool relocated = false;  // the map was found again after a loss
  bool restarted = false;  // a new start was made from direct depths
  int new_points = 0;
  int fused_points = 0;
  int culled_points = 0;
  int culled_keyframes = 0;
  std::string message;  // while lost or initializing: what it waits for
  StageTimes times;
};

class FeatureMapper {
 public:
  // Applies a change and returns the map after it. An error stops the mapping: Process() returns it.
  using Commit = std::function<absl::StatusOr<std::shared_ptr<const map::Snapshot>>(map::Delta)>;

  // Keyframes are added to `session` of `camera`, both of which `map` holds already. An empty map is started from the
  // first packets: its origin is the first keyframe, its scale that of the direct module there. A map with keyframes is
  // extended: the session's keyframes join it once one has been located in it. `vocabulary` may be null (features then
  // have no words, and a lost map is searched only nearby); otherwise it must outlive the mapper. InvalidArgument for
  // bad options or ids that the map does not have.
  static absl::StatusOr<std::unique_ptr<FeatureMapper>> Create(const FeatureMapperOptions& options,
                                                               std::shared_ptr<const map::Snapshot> map,
                                                               SessionId session, CameraId camera,
                                                               const place::Vocabulary* vocabulary, Commit commit);
  ~FeatureMapper();
  FeatureMapper(const FeatureMapper&) = delete;
  FeatureMapper& operator=(const FeatureMapper&) = delete;

  // InvalidArgument, and nothing changes, for a packet that is older than the last or whose image does not fit the
  // camera. The commit function's errors are returned as they are.
  absl::StatusOr<KeyframeReport> Process(const direct::KeyframePacket& packet);

  // Looks for an image anywhere in the map, for an odometry that is lost: the points that it shows, with their depths
  // in the image in map units. None if it is not found, or without a vocabulary. Changes nothing.
  absl::StatusOr<std::optional<direct::KnownView>> Locate(const direct::Frame& frame) const;

  // Ends the session: a wider bundle adjustment over everything this session added, if it is small enough, and the
  // poses of the keyframes that were not inserted refined once more against the final map.
  absl::Status Finish();

  // After Finish(): what the map says of the camera's lens; nothing if it was not asked.
  const std::optional<LensReport>& lens() const;

  // What the direct module has made of its keyframes' poses since their packets, which may have come while it still
  // worked on them: direct_from_camera by the number of the direct keyframe. Call before Trajectory() at the end.
  void ReviseDirectPoses(const std::unordered_map<std::int64_t, SE3>& direct_from_camera);

  // A change of the map that somebody else makes between two calls of Process(), such as closing a loop: commits it and
  // goes on from the map after it. `scales`: by how much lengths around keyframes have grown, 1 for those not named.
  absl::StatusOr<std::shared_ptr<const map::Snapshot>> CommitCorrection(
      map::Delta delta, const std::unordered_map<KeyframeId, double>& scales);

  // The keyframes of map() by their words; null without a vocabulary.
  const tracking::PlaceIndex* places() const;

  // Every direct keyframe processed, as Trajectory() resolves them.
  const KeyframeTrajectory& trajectory() const;

  // The map after the last commit.
  const std::shared_ptr<const map::Snapshot>& map() const;
  FeatureState state() const;

  // Every direct keyframe processed, in temporal order, in the map as `snapshot` has it (usually map()).
  std::vector<TrajectoryKeyframe> Trajectory(const map::Snapshot& snapshot) const;

 private:
  class Impl;
  explicit FeatureMapper(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace cairn::mapping

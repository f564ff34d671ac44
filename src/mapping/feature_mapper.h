// The feature module: takes the packets of the direct module in temporal order (mapping/packet_queue.h), refines the
// pose of each keyframe against the map, inserts the useful ones and keeps the map around them accurate and free of
// clutter. Lee and Civera, "Loosely-Coupled Semi-Direct Monocular SLAM" (RA-L 2019), Sec. V, with the local mapping of
// Mur-Artal, Montiel and Tardos, "ORB-SLAM" (T-RO 2015). Loop closing is a matter of its own.
//
// A session does not know where it is at first: it maps into a component of its own, which is joined to another when
// overlap is proven (mapping/component_join.h). After a loss that nothing bridges it begins a further one.
//
// It works on map::Edit over the newest revision and hands each change as one Delta to the head of the map. Algorithms
// own no threads: call everything from the one mapping thread, while the head is the caller's. Deterministic.
#pragma once

#include <memory>
#include <optional>
#include <unordered_map>
#include <vector>

#include "base/status.h"
#include "direct/packet.h"
#include "map/edit.h"
#include "mapping/feature_mapper_options.h"
#include "mapping/keyframe_trajectory.h"
#include "mapping/map_head.h"

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
  ComponentId component;   // of the map, if located
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
  // Keyframes are added to `session` of `camera`, both of which the map holds already. The first packets start a
  // component of the session's own: its origin is the first keyframe, its scale that of the direct module there.
  // Without a vocabulary in the view of the map features have no words, and a lost map is searched only nearby. `head`
  // must outlive it. InvalidArgument for bad options or ids that the map does not have.
  static absl::StatusOr<std::unique_ptr<FeatureMapper>> Create(const FeatureMapperOptions& options, MapHead* head,
                                                               SessionId session, CameraId camera);
  ~FeatureMapper();
  FeatureMapper(const FeatureMapper&) = delete;
  FeatureMapper& operator=(const FeatureMapper&) = delete;

  // InvalidArgument, and nothing changes, for a packet that is older than the last or whose image does not fit the
  // camera. The errors of the head's Commit() are returned as they are.
  absl::StatusOr<KeyframeReport> Process(const direct::KeyframePacket& packet);

  // Whether every packet is to be inserted from now on. While another component is in view, and that is not proven yet,
  // keyframes are worth more than a small map.
  void InsertEach(bool each);

  // Where a lost odometry is: the points that its image shows, with their depths in units of the component that they
  // are in.
  struct Found {
    direct::KnownView view;
    ComponentId component;
  };
  // Looks for an image anywhere in the map. None if it is not found, or without a vocabulary. Changes nothing.
  absl::StatusOr<std::optional<Found>> Locate(const direct::Frame& frame) const;

  // Ends the session: a wider bundle adjustment over everything this session added, if it is small enough, and the
  // poses of the keyframes that were not inserted refined once more against the final map.
  absl::Status Finish();

  // After Finish(): what the map says of the camera's lens; nothing if it was not asked.
  const std::optional<LensReport>& lens() const;

  // What the direct module has made of its keyframes' poses since their packets, which may have come while it still
  // worked on them: direct_from_camera by the number of the direct keyframe. Call before Trajectory() at the end.
  void ReviseDirectPoses(const std::unordered_map<std::int64_t, SE3>& direct_from_camera);

  // What the head of the map has become by a commit, of whomever: references into it are kept right.
  void OnChange(const tracking::MapView& before, const map::Delta& delta,
                const std::shared_ptr<const tracking::MapView>& after, const KeyframeScales& scales);

  // The component that keyframes are added to; none before the first.
  ComponentId component() const;

  // Every direct keyframe processed, as Trajectory() resolves them.
  const KeyframeTrajectory& trajectory() const;

  // As OnChange() has it.
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

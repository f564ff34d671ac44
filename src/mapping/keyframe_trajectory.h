// Every keyframe of the direct module, whether it became a keyframe of the map or not, with its pose in the map as it
// is now: what is not in the map any more (or never was) hangs on a keyframe that is, and moves with it.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <unordered_map>
#include <vector>

#include "base/time.h"
#include "direct/packet.h"
#include "map/snapshot.h"

namespace cairn::mapping {

// Of one keyframe in the map; the direct module's own state is in its FrameResult.
enum class FeatureState { kInitializing, kGood, kPoor, kLost };
const char* FeatureStateName(FeatureState state);

struct TrajectoryKeyframe {
  std::int64_t direct_keyframe = 0;
  std::int64_t segment = 0;
  std::int64_t frame_index = 0;
  TimeNs time_ns = 0;
  FeatureState state = FeatureState::kInitializing;
  KeyframeId keyframe;  // in the map; none if it was not inserted, or culled since
  SE3 direct_from_camera;
  bool located = false;  // false: nothing links it to the map, the pose below means nothing
  SE3 map_from_camera;
  double map_per_direct = 1.0;  // lengths in the map against lengths in the direct world, around this keyframe
};

class KeyframeTrajectory {
 public:
  struct Entry {
    std::int64_t direct_keyframe = 0;
    std::int64_t segment = 0;
    std::int64_t frame_index = 0;
    TimeNs time_ns = 0;
    FeatureState state = FeatureState::kInitializing;
    SE3 direct_from_camera;
    double map_per_direct = 0.0;  // 0: not known here; that of the next keyframe around is used
    KeyframeId keyframe;          // if inserted; may be culled later
    // Pose by a keyframe in the map, if it was refined against it; none: only the direct module knows it.
    KeyframeId reference;
    SE3 reference_from_camera;  // in map units
  };

  // Direct keyframes must come in temporal order.
  void Add(Entry entry) { entries_.push_back(std::move(entry)); }
  std::vector<Entry>& entries() { return entries_; }
  const std::vector<Entry>& entries() const { return entries_; }

  // Hangs everything that refers to `culled` on `heir` instead; both are still in `map` (as they were before the
  // culling).
  void Reattach(KeyframeId culled, KeyframeId heir, const SE3& heir_from_culled);

  // The direct module's later poses of its keyframes, by their number; those not named stay.
  void ReviseDirectPoses(const std::unordered_map<std::int64_t, SE3>& direct_from_camera);

  // Lengths in the map around these keyframes have grown by the factors given: what hangs on them goes along.
  void Rescale(const std::unordered_map<KeyframeId, double>& scales);

  // One per entry, in temporal order. Entries without a reference get their pose from the refined keyframes of their
  // segment around them, by scaled direct motion; between two of them the difference is spread evenly over time.
  std::vector<TrajectoryKeyframe> Resolve(const map::Snapshot& map) const;

 private:
  std::vector<Entry> entries_;
};

// Poses of [begin, end) by scaled direct motion from the located keyframes beside them, at begin - 1 and at end:
// between both the difference is spread evenly over time. Nothing changes with neither.
void FillByDirectMotion(std::vector<TrajectoryKeyframe>& keyframes, std::size_t begin, std::size_t end, bool has_before,
                        bool has_after);

// The pose in the map of any frame of the direct module, from the resolved keyframes (in temporal order): by scaled
// motion from its reference keyframe, with the difference that this leaves at the next keyframe of the segment spread
// evenly over the time between. Nothing if the frame has no reference keyframe, or that is not located.
std::optional<SE3> PoseOfFrame(const std::vector<TrajectoryKeyframe>& keyframes, const direct::FrameResult& frame);

}  // namespace cairn::mapping

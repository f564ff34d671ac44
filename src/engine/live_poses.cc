#include "engine/live_poses.h"

#include <algorithm>
#include <unordered_map>
#include <utility>

#include "mapping/direct_trajectory.h"

namespace cairn::engine {
namespace {

// The feature module's keyframes with the odometry's newest poses of them, and those between and after that it has not
// had.
mapping::KeyframeTrajectory Completed(const mapping::KeyframeTrajectory& known,
                                      const std::vector<direct::KeyframePose>& keyframes) {
  mapping::KeyframeTrajectory completed;
  auto next = known.entries().begin();
  for (const direct::KeyframePose& keyframe : keyframes) {
    mapping::KeyframeTrajectory::Entry entry;
    if (next != known.entries().end() && next->direct_keyframe == keyframe.keyframe) {
      entry = *next++;
    } else {
      entry.direct_keyframe = keyframe.keyframe;
      entry.segment = keyframe.segment;
      entry.frame_index = keyframe.frame_index;
      entry.time_ns = keyframe.time_ns;
    }
    entry.direct_from_camera = keyframe.direct_from_camera;
    completed.Add(std::move(entry));
  }
  return completed;
}

// By segment of the odometry, the component in which it was found.
std::unordered_map<std::int64_t, ComponentId> ComponentsOfSegments(const map::Snapshot& map,
                                                                   const mapping::KeyframeTrajectory& trajectory) {
  std::unordered_map<std::int64_t, ComponentId> component_of;
  for (const mapping::KeyframeTrajectory::Entry& entry : trajectory.entries()) {
    const map::Keyframe* reference = entry.reference ? map.keyframes().Find(entry.reference) : nullptr;
    if (reference != nullptr) component_of[entry.segment] = reference->component;
  }
  return component_of;
}

}  // namespace

void LivePoses::Publish(std::shared_ptr<const map::Snapshot> map, const mapping::KeyframeTrajectory& trajectory,
                        std::optional<mapping::MapMemoryOptions> memory) {
  auto state = std::make_shared<State>();
  state->map = std::move(map);
  state->trajectory = trajectory;
  state->memory = memory;
  const auto& entries = state->trajectory.entries();
  for (auto entry = entries.rbegin(); entry != entries.rend() && state->segment < 0; ++entry) {
    const map::Keyframe* reference = entry->reference ? state->map->keyframes().Find(entry->reference) : nullptr;
    if (reference == nullptr || !(entry->map_per_direct > 0.0)) continue;
    state->segment = entry->segment;
    state->component = reference->component;
    state->map_from_camera = reference->camera_from_map.Inverse() * entry->reference_from_camera;
    state->direct_from_camera = entry->direct_from_camera;
    state->map_per_direct = entry->map_per_direct;
  }
  std::lock_guard lock(mutex_);
  state_ = std::move(state);
}

std::shared_ptr<const LivePoses::State> LivePoses::Current() const {
  std::lock_guard lock(mutex_);
  return state_;
}

PosesInMap LivePoses::All(const direct::Odometry& odometry, bool assess) const {
  // The state first: the odometry's history then has all its keyframes.
  const std::shared_ptr<const State> state = Current();
  const direct::PoseHistory history = odometry.Poses();
  PosesInMap poses;
  std::unordered_map<std::int64_t, ComponentId> component_of;
  if (state) {
    component_of = ComponentsOfSegments(*state->map, state->trajectory);
    const mapping::KeyframeTrajectory completed = Completed(state->trajectory, history.keyframes);
    const std::vector<mapping::TrajectoryKeyframe> refined = completed.Resolve(*state->map);
    std::vector<mapping::Stretch> direct;
    if (state->memory) direct = mapping::DirectStretches(completed.entries(), *state->map, *state->memory);
    poses.keyframes = mapping::WithDirectStretches(refined, direct);
    if (assess) poses.quality = mapping::AssessTrajectory(state->map, refined, poses.keyframes, direct);
  }
  poses.frames.reserve(history.frames.size());
  for (const direct::FrameResult& frame : history.frames) {
    FramePose pose = {frame.index, frame.time_ns, frame.state, mapping::PoseOfFrame(poses.keyframes, frame),
                      {},          0.0,           {}};
    if (pose.map_from_camera) {
      const auto found = component_of.find(history.keyframes[static_cast<std::size_t>(frame.keyframe)].segment);
      if (found != component_of.end()) pose.component = found->second;
      pose.quality = frame.quality;
    }
    if (pose.map_from_camera && poses.quality) {
      pose.quality = std::min(pose.quality, poses.quality->quality);
      const auto keyframe =
          std::ranges::lower_bound(poses.keyframes, frame.keyframe, {}, &mapping::TrajectoryKeyframe::direct_keyframe);
      pose.sigma = poses.quality->keyframes[static_cast<std::size_t>(keyframe - poses.keyframes.begin())];
    }
    poses.frames.push_back(std::move(pose));
  }
  return poses;
}

std::optional<LivePose> LivePoses::Of(const direct::FrameResult& frame) const {
  const std::shared_ptr<const State> state = Current();
  if (!state || frame.keyframe < 0 || frame.segment != state->segment) return std::nullopt;
  const SE3 motion = state->direct_from_camera.Inverse() * frame.direct_from_camera;
  return LivePose{state->component,
                  state->map_from_camera * SE3(motion.rotation(), state->map_per_direct * motion.translation()),
                  state->map->WorldFrom(state->component)};
}

}  // namespace cairn::engine

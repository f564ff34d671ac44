#include "mapping/keyframe_trajectory.h"

#include <algorithm>
#include <cmath>

#include "geometry/pose_spread.h"

namespace cairn::mapping {
namespace {

// Pose of a camera at `from` moved by the direct motion to `to`.
SE3 Carry(const TrajectoryKeyframe& from, const SE3& direct_from_camera, double scale) {
  return from.map_from_camera * Scaled(from.direct_from_camera.Inverse() * direct_from_camera, scale);
}

double Share(TimeNs begin, TimeNs at, TimeNs end) {
  if (end <= begin) return 0.0;
  return std::clamp(static_cast<double>(at - begin) / static_cast<double>(end - begin), 0.0, 1.0);
}

// Scales where they are unknown: between known ones of the segment evenly in their logarithm, else the nearest.
void FillScales(const std::vector<KeyframeTrajectory::Entry>& entries, std::vector<TrajectoryKeyframe>* resolved) {
  for (std::size_t i = 0; i < entries.size(); ++i) {
    if (entries[i].map_per_direct > 0.0) continue;
    const KeyframeTrajectory::Entry *before = nullptr, *after = nullptr;
    for (std::size_t j = i; j-- > 0 && entries[j].segment == entries[i].segment && before == nullptr;) {
      if (entries[j].map_per_direct > 0.0) before = &entries[j];
    }
    for (std::size_t j = i + 1; j < entries.size() && entries[j].segment == entries[i].segment && after == nullptr;
         ++j) {
      if (entries[j].map_per_direct > 0.0) after = &entries[j];
    }
    double scale = 1.0;
    if (before && after) {
      const double share = Share(before->time_ns, entries[i].time_ns, after->time_ns);
      scale = std::exp((1.0 - share) * std::log(before->map_per_direct) + share * std::log(after->map_per_direct));
    } else if (before || after) {
      scale = (before ? before : after)->map_per_direct;
    }
    (*resolved)[i].map_per_direct = scale;
  }
}

}  // namespace

const char* FeatureStateName(FeatureState state) {
  switch (state) {
    case FeatureState::kInitializing:
      return "initializing";
    case FeatureState::kGood:
      return "good";
    case FeatureState::kPoor:
      return "poor";
    case FeatureState::kLost:
      return "lost";
  }
  return "unknown";
}

void KeyframeTrajectory::Reattach(KeyframeId culled, KeyframeId heir, const SE3& heir_from_culled) {
  for (Entry& entry : entries_) {
    if (entry.reference != culled) continue;
    entry.reference = heir;
    entry.reference_from_camera = heir_from_culled * entry.reference_from_camera;
    if (entry.keyframe == culled) entry.keyframe = KeyframeId();
  }
}

void KeyframeTrajectory::ReviseDirectPoses(const std::unordered_map<std::int64_t, SE3>& direct_from_camera) {
  for (Entry& entry : entries_) {
    const auto pose = direct_from_camera.find(entry.direct_keyframe);
    if (pose != direct_from_camera.end()) entry.direct_from_camera = pose->second;
  }
}

void KeyframeTrajectory::Rescale(const std::unordered_map<KeyframeId, double>& scales) {
  for (Entry& entry : entries_) {
    const auto scale = scales.find(entry.reference);
    if (!entry.reference || scale == scales.end()) continue;
    entry.reference_from_camera = Scaled(entry.reference_from_camera, scale->second);
    entry.map_per_direct *= scale->second;
  }
}

std::vector<TrajectoryKeyframe> KeyframeTrajectory::Resolve(const map::Snapshot& map) const {
  std::vector<TrajectoryKeyframe> resolved(entries_.size());
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    const Entry& entry = entries_[i];
    TrajectoryKeyframe& out = resolved[i];
    out.direct_keyframe = entry.direct_keyframe;
    out.segment = entry.segment;
    out.frame_index = entry.frame_index;
    out.time_ns = entry.time_ns;
    out.state = entry.state;
    out.direct_from_camera = entry.direct_from_camera;
    out.map_per_direct = entry.map_per_direct;
    if (const map::Keyframe* own = map.keyframes().Find(entry.keyframe); entry.keyframe && own != nullptr) {
      out.keyframe = entry.keyframe;
    }
    const map::Keyframe* reference = entry.reference ? map.keyframes().Find(entry.reference) : nullptr;
    if (reference != nullptr) {
      out.map_from_camera = reference->camera_from_map.Inverse() * entry.reference_from_camera;
      out.located = true;
    }
  }
  FillScales(entries_, &resolved);
  for (std::size_t i = 0; i < resolved.size();) {
    if (resolved[i].located) {
      ++i;
      continue;
    }
    std::size_t end = i;
    while (end < resolved.size() && !resolved[end].located && resolved[end].segment == resolved[i].segment) ++end;
    const bool has_before = i > 0 && resolved[i - 1].located && resolved[i - 1].segment == resolved[i].segment;
    const bool has_after =
        end < resolved.size() && resolved[end].located && resolved[end].segment == resolved[i].segment;
    FillByDirectMotion(resolved, i, end, has_before, has_after);
    i = end;
  }
  return resolved;
}

void FillByDirectMotion(std::vector<TrajectoryKeyframe>& keyframes, std::size_t begin, std::size_t end, bool has_before,
                        bool has_after) {
  // Forward from the one before.
  if (has_before) {
    for (std::size_t i = begin; i < end; ++i) {
      const double scale = std::sqrt(keyframes[i - 1].map_per_direct * keyframes[i].map_per_direct);
      keyframes[i].map_from_camera = Carry(keyframes[i - 1], keyframes[i].direct_from_camera, scale);
      keyframes[i].located = true;
    }
    if (!has_after) return;
    const TrajectoryKeyframe& last = keyframes[end - 1];
    const TrajectoryKeyframe& after = keyframes[end];
    const SE3 predicted = Carry(last, after.direct_from_camera, std::sqrt(last.map_per_direct * after.map_per_direct));
    for (std::size_t i = begin; i < end; ++i) {
      const double share = Share(keyframes[begin - 1].time_ns, keyframes[i].time_ns, after.time_ns);
      SE3& pose = keyframes[i].map_from_camera;
      pose = SpreadDifference(pose, predicted, after.map_from_camera, share);
    }
    return;
  }
  if (!has_after) return;
  for (std::size_t i = end; i-- > begin;) {
    const double scale = std::sqrt(keyframes[i].map_per_direct * keyframes[i + 1].map_per_direct);
    keyframes[i].map_from_camera = Carry(keyframes[i + 1], keyframes[i].direct_from_camera, scale);
    keyframes[i].located = true;
  }
}

std::optional<SE3> PoseOfFrame(const std::vector<TrajectoryKeyframe>& keyframes, const direct::FrameResult& frame) {
  if (frame.keyframe < 0) return std::nullopt;
  const auto at = std::lower_bound(keyframes.begin(), keyframes.end(), frame.keyframe,
                                   [](const TrajectoryKeyframe& k, std::int64_t id) { return k.direct_keyframe < id; });
  if (at == keyframes.end() || at->direct_keyframe != frame.keyframe || !at->located) return std::nullopt;
  const TrajectoryKeyframe& reference = *at;
  const auto next = at + 1;
  const bool has_next = next != keyframes.end() && next->located && next->segment == reference.segment &&
                        next->time_ns > reference.time_ns && frame.time_ns >= reference.time_ns &&
                        frame.time_ns <= next->time_ns;
  const double scale = has_next ? std::sqrt(reference.map_per_direct * next->map_per_direct) : reference.map_per_direct;
  const SE3 pose = reference.map_from_camera * Scaled(frame.keyframe_from_camera, scale);
  if (!has_next) return pose;
  const SE3 predicted = Carry(reference, next->direct_from_camera, scale);
  return SpreadDifference(pose, predicted, next->map_from_camera,
                          Share(reference.time_ns, frame.time_ns, next->time_ns));
}

}  // namespace cairn::mapping

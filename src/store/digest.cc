#include "store/digest.h"

#include <bit>
#include <optional>
#include <type_traits>

#include "absl/strings/str_format.h"
#include "geometry/camera.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace cairn::store {
namespace {

class Hasher {
 public:
  Hasher() { XXH3_128bits_reset(&state_); }

  template <class Number>
  requires std::is_arithmetic_v<Number>
  void Add(Number value) { XXH3_128bits_update(&state_, &value, sizeof(value)); }
  template <class Tag>
  void Add(Id<Tag> id) {
    Add(id.value());
  }
  void Add(absl::string_view text) {
    Add(static_cast<std::uint64_t>(text.size()));
    XXH3_128bits_update(&state_, text.data(), text.size());
  }
  void Add(const Quaterniond& q) {
    for (const double value : {q.x(), q.y(), q.z(), q.w()}) Add(value);
  }
  void Add(const Vector3d& v) {
    for (const double value : {v.x(), v.y(), v.z()}) Add(value);
  }
  void Add(const SE3& pose) {
    Add(pose.rotation());
    Add(pose.translation());
  }
  void Add(const Pinhole& camera) {
    Add(camera.width_px);
    Add(camera.height_px);
    for (const double value : {camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px}) Add(value);
  }
  void AddCount(std::size_t count) { Add(static_cast<std::uint64_t>(count)); }

  std::string Digest() {
    const XXH128_hash_t hash = XXH3_128bits_digest(&state_);
    return absl::StrFormat("%016x%016x", hash.high64, hash.low64);
  }

 private:
  // XXH3 keeps its state in aligned memory.
  alignas(64) XXH3_state_t state_;
};

void Add(const std::optional<Sim3>& similarity, Hasher* hasher) {
  hasher->Add(similarity.has_value());
  if (!similarity) return;
  hasher->Add(similarity->scale());
  hasher->Add(similarity->rotation());
  hasher->Add(similarity->translation());
}

// A map of one component has the digest that it had in formats without components.
bool HasParts(const map::Snapshot& map) { return map.components().size() > 1; }

void AddInfo(const map::Snapshot& map, Hasher* hasher) {
  const map::MapInfo& info = map.info();
  const image::OrbParameters& orb = info.orb;
  for (const int value : {orb.num_features, orb.num_levels, orb.fast_threshold, orb.min_fast_threshold})
    hasher->Add(value);
  hasher->Add(orb.scale_factor);
  hasher->Add(info.vocabulary_hash);
  if (!HasParts(map)) {
    Add(map.components().empty() ? std::nullopt : map.components().begin()->second.world_from_component, hasher);
  }
  if (const auto& anchor = info.geo_anchor) {
    for (const double value : {anchor->latitude_deg, anchor->longitude_deg, anchor->height_m}) hasher->Add(value);
    hasher->Add(anchor->enu_from_world);
  }
  if (!HasParts(map)) return;
  hasher->AddCount(map.components().size());
  for (const auto& [id, component] : map.components()) {
    hasher->Add(id);
    hasher->Add(component.session);
    Add(component.world_from_component, hasher);
    if (!component.joined) continue;
    hasher->Add(component.joined->into);
    Add(component.joined->into_from_component, hasher);
  }
}

void AddFeatures(const map::KeyframeFeatures& features, Hasher* hasher) {
  hasher->AddCount(features.features.size());
  for (const image::Keypoint& keypoint : features.features.keypoints) {
    for (const float value : {keypoint.x_px, keypoint.y_px, keypoint.angle_rad}) hasher->Add(value);
    hasher->Add(keypoint.octave);
  }
  for (const image::Descriptor& descriptor : features.features.descriptors) {
    for (const std::uint64_t word : descriptor) hasher->Add(word);
  }
  hasher->AddCount(features.words.size());
  for (const std::uint32_t word : features.words) hasher->Add(word);
}

void AddKeyframe(const map::Keyframe& keyframe, Hasher* hasher) {
  hasher->Add(keyframe.id);
  hasher->Add(keyframe.session);
  hasher->Add(keyframe.camera);
  hasher->Add(keyframe.time_ns);
  hasher->Add(keyframe.frame_index);
  hasher->Add(keyframe.camera_from_map);
  hasher->Add(keyframe.camera_from_direct);
  hasher->Add(keyframe.direct_segment);
  hasher->Add(keyframe.parent);
  AddFeatures(*keyframe.features.Get(), hasher);
  for (const PointId id : keyframe.points) hasher->Add(id);
  hasher->AddCount(keyframe.covisible.size());
  for (const map::CovisibilityEdge& edge : keyframe.covisible) {
    hasher->Add(edge.keyframe);
    hasher->Add(edge.shared_points);
  }
}

}  // namespace

std::string ContentDigest(const map::Snapshot& snapshot) {
  Hasher hasher;
  AddInfo(snapshot, &hasher);
  hasher.AddCount(snapshot.cameras().size());
  for (const auto& [id, camera] : snapshot.cameras()) {
    hasher.Add(id);
    hasher.Add(camera.name);
    hasher.Add(CameraModelName(camera.model.model));
    hasher.Add(camera.model.Intrinsics());
    hasher.AddCount(camera.model.distortion.size());
    for (const double value : camera.model.distortion) hasher.Add(value);
    hasher.Add(camera.pinhole);
    if (camera.lens) {
      for (const double value : {camera.lens->focal_scale, camera.lens->k1, camera.lens->k2}) hasher.Add(value);
    }
  }
  hasher.AddCount(snapshot.sessions().size());
  for (const auto& [id, session] : snapshot.sessions()) {
    hasher.Add(id);
    hasher.Add(session.camera);
    hasher.Add(session.source);
    hasher.Add(session.first_ns);
    hasher.Add(session.last_ns);
    hasher.Add(session.complete);
    if (session.removed) hasher.Add(session.removed);
  }
  hasher.AddCount(snapshot.keyframes().size());
  snapshot.keyframes().ForEach([&](const auto& keyframe) {
    AddKeyframe(*keyframe, &hasher);
    if (HasParts(snapshot)) hasher.Add(keyframe->component);
  });
  hasher.AddCount(snapshot.points().size());
  snapshot.points().ForEach([&](const auto& point) {
    hasher.Add(point->id);
    hasher.Add(point->position);
    hasher.Add(point->reference.keyframe);
    hasher.Add(point->times_visible);
    hasher.Add(point->times_found);
  });
  return hasher.Digest();
}

}  // namespace cairn::store

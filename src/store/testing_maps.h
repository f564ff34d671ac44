// Maps for the tests of the store: seeded, realistic in their proportions, grown only through map::Edit.
#pragma once

#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "base/random.h"
#include "map/edit.h"
#include "map/snapshot.h"

namespace cairn::store::testing {

using SnapshotPtr = std::shared_ptr<const map::Snapshot>;

struct GrowOptions {
  int features = 60;        // per keyframe
  int new_points = 15;      // per keyframe
  int views_per_point = 4;  // consecutive keyframes that see a point
  bool fixed_point_keypoints = true;
  std::uint32_t num_words = 100000;
};

inline map::MapInfo TestInfo() {
  map::MapInfo info;
  info.id = "0123456789abcdef0123456789abcdef";
  info.name = "office";
  info.software_version = "0.1.0";
  info.created_unix_ns = 1700000000123456789;
  info.vocabulary_hash = 0xfedcba9876543210ull;
  return info;
}

// A camera that moves along x past points a few units away.
class MapGrower {
 public:
  explicit MapGrower(std::uint64_t seed, GrowOptions options = {}) : random_(seed), options_(options) {}

  map::Delta Start(std::shared_ptr<const map::Snapshot> base) {
    map::Edit edit(std::move(base));
    map::MapCamera camera;
    camera.name = "cam0";
    camera.model.model = CameraModel::kRadialTangential;
    camera.model.width_px = 640;
    camera.model.height_px = 480;
    camera.model.fx_px = 458.654;
    camera.model.fy_px = 457.296;
    camera.model.cx_px = 320.5;
    camera.model.cy_px = 240.25;
    camera.model.distortion = {-0.2834, 0.0739, 0.00019, 1.76e-05};
    camera.pinhole = Pinhole{640, 480, 430.1, 430.2, 319.5, 239.5};
    map::Session session;
    session.camera = edit.AddCamera(camera);
    session.source = "redkitchen \"quoted\" \xc3\xa4";
    session.software_version = "0.1.0";
    session.settings_json = "{\"seed\":1}";
    session.first_ns = 1403715273262142976;
    session.last_ns = session.first_ns;
    session.started_unix_ns = 1700000000000000000;
    edit.AddSession(session);
    return edit.Finish("start of a session");
  }

  // Features, observations of points of earlier keyframes, new points seen by the keyframe before and this one.
  map::Delta AddKeyframe(std::shared_ptr<const map::Snapshot> base) {
    map::Edit edit(base);
    map::Keyframe keyframe;
    const int index = static_cast<int>(base->next_keyframe().value());
    keyframe.session = SessionId(1);
    keyframe.camera = CameraId(1);
    keyframe.time_ns = 1403715273262142976 + index * 250000000ll;
    keyframe.frame_index = 7 * index;
    keyframe.camera_from_map = PoseAt(index).Inverse();
    keyframe.camera_from_direct = index == 1 ? SE3() : PoseAt(index * 1.01);
    keyframe.direct_segment = index / 10;
    keyframe.features = RandomFeatures();
    const KeyframeId id = edit.AddKeyframe(keyframe);

    std::uint32_t feature = 0;
    const auto next_feature = [&] { return feature += 1 + static_cast<std::uint32_t>(random_.Below(2)); };
    base->points().ForEach([&](const auto& point) {
      const std::uint32_t first = point->observations.front().keyframe.value();
      const std::uint32_t views = static_cast<std::uint32_t>(options_.views_per_point);
      if (base->keyframe(point->observations.front().keyframe).component != ComponentId(1)) return;
      if (first + views <= id.value() || feature + 2 >= keyframe.features->features.size()) return;
      if (random_.Uniform() < 0.1) return;
      edit.AddObservation(point->id, id, next_feature());
      edit.AddVisibility(point->id, 1 + static_cast<int>(random_.Below(20)), 1);
    });
    for (int i = 0; i < options_.new_points; ++i) {
      if (feature + 2 >= keyframe.features->features.size()) break;
      const Vector3d position(0.1 * index + random_.Normal(0, 1), random_.Normal(0, 1), 3 + random_.Uniform(-1, 1));
      edit.AddObservation(edit.AddPoint(position), id, next_feature());
    }
    return edit.Finish("insert keyframe " + std::to_string(id.value()));
  }

  // Moves the newest keyframes and everything that they see.
  map::Delta Adjust(std::shared_ptr<const map::Snapshot> base, int num_keyframes) {
    map::Edit edit(base);
    const int newest = static_cast<int>(base->next_keyframe().value()) - 1;
    for (int i = newest; i > std::max(0, newest - num_keyframes); --i) {
      const KeyframeId id(static_cast<std::uint32_t>(i));
      const map::Keyframe* keyframe = base->keyframes().Find(id);
      if (keyframe == nullptr) continue;
      Vector6d change;
      for (int k = 0; k < 6; ++k) change[k] = random_.Normal(0, 1e-3);
      edit.SetPose(id, SE3::Exp(change) * keyframe->camera_from_map);
      for (const PointId point : keyframe->points) {
        if (point) edit.SetPosition(point, base->point(point).position + Vector3d::Constant(random_.Normal(0, 1e-3)));
      }
    }
    return edit.Finish("local bundle adjustment");
  }

  // Removes a keyframe, some points, and fuses two.
  map::Delta Cull(std::shared_ptr<const map::Snapshot> base) {
    map::Edit edit(base);
    std::vector<KeyframeId> keyframes;
    std::vector<PointId> points;
    base->keyframes().ForEach([&](const auto& keyframe) { keyframes.push_back(keyframe->id); });
    base->points().ForEach([&](const auto& point) { points.push_back(point->id); });
    for (int i = 0; i < 5; ++i) {
      const PointId id = points[random_.Below(points.size())];
      if (edit.FindPoint(id) != nullptr) edit.ErasePoint(id);
    }
    const PointId from = points[random_.Below(points.size())], into = points[random_.Below(points.size())];
    const auto component = [&](PointId id) { return base->keyframe(base->point(id).reference.keyframe).component; };
    if (edit.FindPoint(from) != nullptr && edit.FindPoint(into) != nullptr && component(from) == component(into)) {
      edit.FusePoints(from, into);
    }
    edit.EraseKeyframe(keyframes[random_.Below(keyframes.size())]);
    return edit.Finish("cull");
  }

  map::Delta Align(std::shared_ptr<const map::Snapshot> base) {
    map::Edit edit(base);
    map::Component component = base->components().begin()->second;
    component.world_from_component =
        Sim3(ExpSO3(Vector3d(0.1, -0.2, 0.3)), Vector3d(1, -2, -0.0), random_.Uniform(0.5, 3.0));
    edit.PutComponent(component);
    map::MapInfo info = base->info();
    info.geo_anchor = map::GeoAnchor{random_.Uniform(-80, 80), -0.0, 412.25, Quaterniond(ExpSO3(Vector3d(0, 0, 0.7)))};
    edit.SetInfo(info);
    return edit.Finish("align to reference_sfm.txt");
  }

  std::shared_ptr<const map::KeyframeFeatures> RandomFeatures() {
    auto features = std::make_shared<map::KeyframeFeatures>();
    for (int i = 0; i < options_.features; ++i) {
      image::Keypoint keypoint;
      keypoint.x_px = Position(639);
      keypoint.y_px = Position(479);
      keypoint.angle_rad = static_cast<float>(random_.Uniform(-3.14, 3.14));
      keypoint.octave = static_cast<std::uint8_t>(random_.Below(8));
      features->features.keypoints.push_back(keypoint);
      features->features.descriptors.push_back({random_.Next(), random_.Next(), random_.Next(), random_.Next()});
      features->words.push_back(static_cast<std::uint32_t>(random_.Below(options_.num_words)));
    }
    return features;
  }

 private:
  static SE3 PoseAt(double index) {
    return SE3(ExpSO3(Vector3d(0.01 * index, -0.02, 0.003 * index)), Vector3d(0.1 * index, 0.0, -0.02 * index));
  }
  float Position(int size) {
    if (!options_.fixed_point_keypoints) return static_cast<float>(random_.Uniform(0, size));
    return static_cast<float>(random_.Below(static_cast<std::uint64_t>(size) * 32)) / 32.0f;
  }

  Random random_;
  GrowOptions options_;
};

// Every bit of a snapshot, what is derived included.
class Bits {
 public:
  explicit Bits(const map::Snapshot& snapshot) {
    Add(snapshot.revision());
    Add(snapshot.next_keyframe());
    Add(snapshot.next_point());
    Add(snapshot.next_camera());
    Add(snapshot.next_session());
    Add(snapshot.next_component());
    for (const auto& [id, component] : snapshot.components()) AddComponent(component);
    AddInfo(snapshot.info());
    for (const auto& [id, camera] : snapshot.cameras()) {
      Add(id);
      Text(camera.name);
      Add(camera.model.model);
      Add(camera.model.Intrinsics());
      for (const double value : camera.model.distortion) Add(value);
      Add(camera.pinhole);
      if (camera.lens) {
        for (const double value : {camera.lens->focal_scale, camera.lens->k1, camera.lens->k2}) Add(value);
      }
    }
    for (const auto& [id, session] : snapshot.sessions()) {
      Add(id);
      Add(session.camera);
      for (const std::string& text : {session.source, session.software_version, session.settings_json}) Text(text);
      for (const std::int64_t value :
           {session.first_ns, session.last_ns, session.started_unix_ns, session.ended_unix_ns}) {
        Add(value);
      }
      Add(session.complete);
      Add(session.removed);
      Add(session.policy);
      Add(session.result);
      for (const ComponentId component : session.components) Add(component);
      for (const map::ClosedLoop& loop : session.loops) {
        for (const KeyframeId keyframe : {loop.keyframe, loop.loop_keyframe}) Add(keyframe);
        for (const std::int64_t value : {loop.keyframe_time_ns, loop.loop_time_ns}) Add(value);
        Add(loop.matches);
        for (const double value : {loop.scale, loop.shift, loop.turn_rad, loop.way}) Add(value);
      }
      Add(session.trajectory.has_value());
      if (!session.trajectory) continue;
      Add(session.trajectory->refined);
      for (const int value : {session.trajectory->keyframes, session.trajectory->collinear}) Add(value);
      Text(session.trajectory->reason);
    }
    snapshot.keyframes().ForEach([&](const auto& keyframe) { AddKeyframe(*keyframe); });
    snapshot.points().ForEach([&](const auto& point) { AddPoint(*point); });
  }
  bool operator==(const Bits&) const = default;

 private:
  template <class T>
  void Add(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    bits_.append(reinterpret_cast<const char*>(&value), sizeof(value));
  }
  void Text(const std::string& text) {
    Add(text.size());
    bits_ += text;
  }
  template <class Matrix>
  void AddMatrix(const Matrix& matrix) {
    for (Eigen::Index i = 0; i < matrix.size(); ++i) Add(matrix.data()[i]);
  }
  void AddPose(const SE3& pose) {
    AddMatrix(pose.rotation().coeffs());
    AddMatrix(pose.translation());
  }
  void AddInfo(const map::MapInfo& info) {
    for (const std::string& text : {info.id, info.name, info.software_version}) Text(text);
    Add(info.created_unix_ns);
    Add(info.orb.num_features);
    Add(info.orb.num_levels);
    Add(info.orb.scale_factor);
    Add(info.orb.fast_threshold);
    Add(info.orb.min_fast_threshold);
    Add(info.vocabulary_hash);
    Add(info.geo_anchor.has_value());
    if (!info.geo_anchor) return;
    for (const double value :
         {info.geo_anchor->latitude_deg, info.geo_anchor->longitude_deg, info.geo_anchor->height_m})
      Add(value);
    AddMatrix(info.geo_anchor->enu_from_world.coeffs());
  }
  void AddSimilarity(const Sim3& similarity) {
    Add(similarity.scale());
    AddMatrix(similarity.rotation().coeffs());
    AddMatrix(similarity.translation());
  }
  void AddComponent(const map::Component& component) {
    Add(component.id);
    Add(component.session);
    Add(component.world_from_component.has_value());
    if (component.world_from_component) AddSimilarity(*component.world_from_component);
    Add(component.joined.has_value());
    if (!component.joined) return;
    const map::ComponentJoin& joined = *component.joined;
    Add(joined.into);
    AddSimilarity(joined.into_from_component);
    for (const KeyframeId keyframe : {joined.keyframe, joined.into_keyframe}) Add(keyframe);
    for (const int value : {joined.matches, joined.keyframes_agreeing, joined.keyframes_checked}) Add(value);
    for (const std::int64_t value : {joined.keyframe_time_ns, joined.joined_unix_ns}) Add(value);
    Add(joined.revision);
  }
  void AddKeyframe(const map::Keyframe& keyframe) {
    Add(keyframe.id);
    Add(keyframe.session);
    Add(keyframe.camera);
    Add(keyframe.component);
    Add(keyframe.time_ns);
    Add(keyframe.frame_index);
    AddPose(keyframe.camera_from_map);
    AddPose(keyframe.camera_from_direct);
    Add(keyframe.direct_segment);
    for (const image::Keypoint& keypoint : keyframe.keypoints()) {
      for (const float value : {keypoint.x_px, keypoint.y_px, keypoint.angle_rad}) Add(value);
      Add(keypoint.octave);
    }
    for (const image::Descriptor& descriptor : keyframe.descriptors()) Add(descriptor);
    for (const std::uint32_t word : keyframe.features->words) Add(word);
    for (const PointId id : keyframe.points) Add(id);
    Add(keyframe.parent);
    for (const KeyframeId id : keyframe.children) Add(id);
    for (const map::CovisibilityEdge& edge : keyframe.covisible) {
      Add(edge.keyframe);
      Add(edge.shared_points);
    }
  }
  void AddPoint(const map::MapPoint& point) {
    Add(point.id);
    AddMatrix(point.position);
    for (const map::Observation& observation : point.observations) {
      Add(observation.keyframe);
      Add(observation.feature);
    }
    Add(point.times_visible);
    Add(point.times_found);
    Add(point.reference.keyframe);
    Add(point.reference.feature);
    Add(point.descriptor);
    AddMatrix(point.mean_view_direction);
    Add(point.pixel_size);
  }

  std::string bits_;
};

inline bool SameBits(const map::Snapshot& a, const map::Snapshot& b) { return Bits(a) == Bits(b); }

// A folder of its own, removed in the end. In memory where there is a file system for that, unless `on_disk`: waiting
// for a busy disk tests nothing.
class TempFolder {
 public:
  explicit TempFolder(bool on_disk = false) {
    const bool in_memory = !on_disk && access("/dev/shm", W_OK) == 0;
    const std::filesystem::path parent = in_memory ? "/dev/shm" : std::filesystem::temp_directory_path();
    std::string name = (parent / "cairn_store_XXXXXX").string();
    path_ = mkdtemp(name.data());
  }
  ~TempFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  std::string File(const std::string& name) const { return path_ + "/" + name; }
  const std::string& path() const { return path_; }
  std::vector<std::string> Names() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(path_))
      names.push_back(entry.path().filename().string());
    return names;
  }

 private:
  std::string path_;
};

}  // namespace cairn::store::testing

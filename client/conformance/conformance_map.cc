#include "client/conformance/conformance_map.h"

#include <cmath>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <vector>

#include "image/orb_extractor.h"
#include "map/edit.h"
#include "place/training.h"
#include "store/sqlite_map_store.h"
#include "tracking/projection_matcher.h"

namespace cairn::conformance {
namespace {

[[noreturn]] void Fail(const absl::Status& status) {
  std::cerr << "conformance map: " << status << "\n";
  std::abort();
}

template <class T>
T ValueOrFail(absl::StatusOr<T> result) {
  if (!result.ok()) Fail(result.status());
  return *std::move(result);
}

map::MapInfo Info() {
  map::MapInfo info;
  info.id = "00112233445566778899aabbccddeeff";
  info.name = "conformance";
  info.software_version = "test";
  info.orb.num_features = 600;
  return info;
}

std::vector<SE3> KeyframePoses() {
  std::vector<SE3> poses;
  for (int i = 0; i < 10; ++i) {
    poses.push_back(LookInRoom({-1.2 + 0.27 * i, 0.1 * std::sin(i), -1.5}, 0.4 * std::sin(0.8 * i)));
  }
  return poses;
}

// Features see the points that features of earlier keyframes made, from `first` on, and make points of their own where
// their rays end.
void AddPoints(const ConformanceMap& made, KeyframeId id, PointId first, map::Edit* edit) {
  const map::Keyframe& keyframe = edit->keyframe(id);
  const image::Features& features = keyframe.features->features;
  const image::FeatureGrid grid(features.keypoints, made.pinhole.width_px, made.pinhole.height_px);
  std::vector<const map::MapPoint*> points;
  std::vector<PointId> ids;
  for (std::uint32_t i = first.value(); edit->FindPoint(PointId(i)) != nullptr; ++i) {
    edit->UpdatePoint(PointId(i));
    points.push_back(edit->FindPoint(PointId(i)));
    ids.push_back(PointId(i));
  }
  const auto found = tracking::MatchByProjection({made.pinhole, features, grid}, keyframe.camera_from_map, points,
                                                 edit->info().orb, {.radius_factor = 1.5, .max_distance = 60});
  for (const auto& match : found.matches) edit->AddObservation(ids[match.point], id, match.feature);
  const SE3 map_from_camera = edit->keyframe(id).camera_from_map.Inverse();
  for (std::uint32_t i = 0; i < features.size(); ++i) {
    if (edit->keyframe(id).points[i]) continue;
    const Vector3d ray = made.pinhole.Unproject({features.keypoints[i].x_px, features.keypoints[i].y_px});
    const PointId point =
        edit->AddPoint(RenderedRoom::Hit(map_from_camera.translation(), map_from_camera.rotation() * ray));
    edit->AddObservation(point, id, i);
  }
}

// With so many components that are all of the same room.
const ConformanceMap* Make(int components) {
  auto* made = new ConformanceMap;
  made->pinhole = {480, 360, 350.0, 350.0, 239.5, 179.5};
  map::MapInfo info = Info();
  const image::OrbExtractor extractor(info.orb);
  const std::vector<SE3> poses = KeyframePoses();
  std::vector<image::Features> features;
  std::vector<place::ImageDescriptors> descriptors;
  for (const SE3& pose : poses) {
    features.push_back(ValueOrFail(extractor.Extract(made->room.Render(made->pinhole, pose))));
    descriptors.push_back(features.back().descriptors);
  }
  const place::Vocabulary vocabulary = ValueOrFail(place::Train(descriptors, {.branching = 8, .depth = 3}));
  made->vocabulary = vocabulary.Serialize();
  info.vocabulary_hash = vocabulary.hash();

  const auto empty = map::Snapshot::Empty(info);
  map::Edit edit(empty);
  map::MapCamera camera;
  camera.name = "cam0";
  camera.model = Camera::FromPinhole(made->pinhole);
  camera.pinhole = made->pinhole;
  map::Keyframe keyframe;
  keyframe.camera = edit.AddCamera(camera);
  map::Session session;
  session.camera = keyframe.camera;
  session.source = "rendered";
  session.complete = true;
  keyframe.session = edit.AddSession(session);
  std::vector<std::shared_ptr<const map::KeyframeFeatures>> seen;
  for (image::Features& found : features) {
    auto shared = std::make_shared<map::KeyframeFeatures>();
    for (const auto& descriptor : found.descriptors) shared->words.push_back(vocabulary.Lookup(descriptor));
    shared->features = std::move(found);
    seen.push_back(std::move(shared));
  }
  PointId::Value points = 0;
  for (int number = 0; number < components; ++number) {
    map::Component component;
    component.world_from_component = Sim3(Quaterniond::Identity(), Vector3d(10.0 + 30.0 * number, 0.0, 0.0), 2.0);
    keyframe.component = edit.AddComponent(component);
    const PointId first(points + 1);
    for (std::size_t i = 0; i < poses.size(); ++i) {
      keyframe.features = seen[i];
      keyframe.camera_from_map = poses[i];
      keyframe.time_ns = static_cast<TimeNs>(i) * 1'000'000'000;
      keyframe.frame_index = static_cast<std::int64_t>(i);
      AddPoints(*made, edit.AddKeyframe(keyframe), first, &edit);
    }
    while (edit.FindPoint(PointId(points + 1)) != nullptr) ++points;
  }
  made->delta = edit.Finish("conformance map");
  made->snapshot = ValueOrFail(empty->Apply(made->delta));
  return made;
}

}  // namespace

const ConformanceMap& TheConformanceMap() {
  static const ConformanceMap* map = Make(1);
  return *map;
}

const ConformanceMap& TheTwinMap() {
  static const ConformanceMap* map = Make(2);
  return *map;
}

absl::Status WriteConformanceMap(const std::string& path, const ConformanceMap& map) {
  store::CreateOptions options;
  options.vocabulary = map.vocabulary;
  CAIRN_ASSIGN_OR_RETURN(const auto file, store::SqliteMapStore::Create(path, map.snapshot->info(), options));
  CAIRN_RETURN_IF_ERROR(file->Commit(map.delta));
  return file->Close();
}

Camera AnotherCamera() {
  Camera camera;
  camera.model = CameraModel::kRadialTangential;
  camera.width_px = 400;
  camera.height_px = 320;
  camera.fx_px = camera.fy_px = 280.0;
  camera.cx_px = 205.0;
  camera.cy_px = 155.0;
  camera.distortion = {-0.2, 0.05, 0.001, -0.0005};
  return camera;
}

SE3 LookInRoom(const Vector3d& center, double yaw_rad) {
  return SE3(Quaterniond(Eigen::AngleAxisd(yaw_rad, Vector3d::UnitY())), center).Inverse();
}

}  // namespace cairn::conformance

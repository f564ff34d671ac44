// Maps that change in every way that there is, for tests.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "map/lens.h"
#include "store/testing_maps.h"

namespace cairn::store::testing {

// Changes of every kind, in a random order.
class MapMutator {
 public:
  explicit MapMutator(std::uint64_t seed) : random_(seed), grower_(seed, {.features = 40, .new_points = 12}) {}

  map::Delta Start(const SnapshotPtr& map) { return grower_.Start(map); }

  map::Delta Next(const SnapshotPtr& map) {
    if (map->keyframes().size() < 6) return grower_.AddKeyframe(map);
    switch (random_.Below(12)) {
      case 0:
        return grower_.Adjust(map, 3);
      case 1:
        return grower_.Cull(map);
      case 2:
        return grower_.Align(map);
      case 3:
        return BeginComponent(map);
      case 4:
        return map->LiveComponents().size() > 1 ? Join(map) : grower_.Adjust(map, 2);
      case 5:
        return CorrectLens(map);
      case 6:
        return CloseLoop(map);
      case 7:
        return AddCameraAndSession(map);
      case 8:
        return RemoveUnused(map);
      default:
        return grower_.AddKeyframe(map);
    }
  }

 private:
  map::Delta BeginComponent(const SnapshotPtr& map) {
    map::Edit edit(map);
    edit.SetSession(SessionId(1));
    const ComponentId component = edit.AddComponent({ComponentId(), SessionId(1)});
    std::vector<KeyframeId> keyframes;
    for (int i = 0; i < 3; ++i) {
      map::Keyframe keyframe;
      keyframe.session = SessionId(1);
      keyframe.camera = CameraId(1);
      keyframe.component = component;
      keyframe.time_ns = 5000 + i;
      keyframe.camera_from_map = SE3(ExpSO3(Vector3d(0, 0.1 * i, 0)), Vector3d(0.1 * i, 0, 0));
      keyframe.features = grower_.RandomFeatures();
      keyframes.push_back(edit.AddKeyframe(keyframe));
    }
    for (std::uint32_t feature = 0; feature < 20; ++feature) {
      const PointId point = edit.AddPoint(Vector3d(random_.Normal(), random_.Normal(), 4));
      for (const KeyframeId keyframe : keyframes) edit.AddObservation(point, keyframe, feature);
    }
    return edit.Finish("component " + std::to_string(component.value()));
  }

  map::Delta Join(const SnapshotPtr& map) {
    const std::vector<ComponentId> live = map->LiveComponents();
    map::ComponentJoin join;
    join.into = live.front();
    join.into_from_component = Sim3(ExpSO3(Vector3d(0.1, 0.2, 0)), Vector3d(3, 0, -1), random_.Uniform(0.5, 2));
    map->keyframes().ForEach([&](const auto& keyframe) {
      if (keyframe->component == live.back()) join.keyframe = keyframe->id;
      if (keyframe->component == live.front()) join.into_keyframe = keyframe->id;
    });
    join.matches = 40;
    join.keyframes_agreeing = 3;
    join.keyframes_checked = 4;
    join.revision = map->revision() + 1;
    map::Edit edit(map);
    edit.JoinComponent(live.back(), join);
    return edit.Finish("join");
  }

  map::Delta CorrectLens(const SnapshotPtr& map) {
    map::Edit edit(map);
    map::MapCamera camera = map->cameras().begin()->second;
    camera.lens = LensCorrection{1.0 + random_.Normal(0, 1e-3), random_.Normal(0, 1e-2), 0.0};
    edit.PutCamera(camera);
    map->keyframes().ForEach([&](const auto& keyframe) {
      if (random_.Below(2) == 0) return;
      std::vector<image::Keypoint> keypoints = keyframe->keypoints();
      map::CorrectKeypoints(camera, keypoints);
      edit.SetKeypoints(keyframe->id, keypoints);
    });
    return edit.Finish("lens");
  }

  map::Delta CloseLoop(const SnapshotPtr& map) {
    map::Edit edit(map);
    map::Session session = map->sessions().begin()->second;
    session.loops.push_back({KeyframeId(5), 2, KeyframeId(1), 1, 50, 1.01, 0.25, 0.1, 60.5});
    session.trajectory = map::ReportedTrajectory{true, 4, 0, "refined: a loop was closed"};
    edit.PutSession(session);
    return edit.Finish("close loop");
  }

  map::Delta AddCameraAndSession(const SnapshotPtr& map) {
    map::Edit edit(map);
    map::MapCamera camera = map->cameras().begin()->second;
    camera.name = "another";
    edit.AddCamera(camera);
    map::Session session = map->sessions().begin()->second;
    session.policy = map::SessionPolicy::kExtend;
    session.result = map::SessionResult::kApart;
    session.removed = random_.Below(2) == 0;
    edit.AddSession(session);
    edit.AddComponent({ComponentId(), SessionId(1)});  // stays empty
    return edit.Finish("camera, session, component");
  }

  // A camera that no session has, and a component that is no keyframe's and no history.
  map::Delta RemoveUnused(const SnapshotPtr& map) {
    map::Delta delta;
    delta.base = map->revision();
    delta.reason = "remove what is not used";
    for (const auto& [id, camera] : map->cameras()) {
      if (id != CameraId(1)) delta.removed_cameras.push_back(id);
    }
    for (const auto& [id, component] : map->components()) {
      bool is_target = map->NumKeyframes(id) > 0 || component.joined.has_value();
      for (const auto& [other, joined] : map->components()) {
        is_target = is_target || (joined.joined && joined.joined->into == id);
      }
      for (const auto& [session_id, session] : map->sessions()) {
        const auto& touched = session.components;
        is_target = is_target || std::find(touched.begin(), touched.end(), id) != touched.end();
      }
      if (!is_target) delta.removed_components.push_back(id);
    }
    return delta;
  }

  Random random_;
  MapGrower grower_;
};

}  // namespace cairn::store::testing

// Small maps for tests: cameras in a row that look at a cloud of points, every point with its own descriptor.
#pragma once

#include <memory>
#include <vector>

#include "base/random.h"
#include "image/testing_descriptors.h"
#include "map/edit.h"

namespace cairn::map::testing {

inline const Pinhole kPinhole{640, 480, 500.0, 500.0, 320.0, 240.0};

struct TestMap {
  std::shared_ptr<const Snapshot> snapshot;
  SessionId session;
  CameraId camera;
  std::vector<Vector3d> truth;  // the points of the world
  std::vector<SE3> poses;       // camera_from_map of the cameras of the world
  std::vector<image::Descriptor> descriptors;
};

// A keyframe that sees every point of the world in its image; feature i is that of `visible[i]`. `noise_px` is added to
// the pixels, a few bits of each descriptor flip.
inline Keyframe MakeKeyframe(const TestMap& world, std::size_t view, double noise_px, Random& random,
                             std::vector<std::size_t>* visible) {
  Keyframe keyframe;
  keyframe.session = world.session;
  keyframe.camera = world.camera;
  keyframe.time_ns = static_cast<TimeNs>(view) * 100000000;
  keyframe.frame_index = static_cast<std::int64_t>(view);
  keyframe.camera_from_map = world.poses[view];
  auto features = std::make_shared<KeyframeFeatures>();
  visible->clear();
  for (std::size_t i = 0; i < world.truth.size(); ++i) {
    const Vector3d point_c = world.poses[view] * world.truth[i];
    if (point_c.z() <= 0.1) continue;
    const Vector2d pixel = kPinhole.Project(point_c) + noise_px * Vector2d(random.Normal(), random.Normal());
    if (!kPinhole.Contains(pixel)) continue;
    image::Keypoint keypoint;
    keypoint.x_px = static_cast<float>(pixel.x());
    keypoint.y_px = static_cast<float>(pixel.y());
    keypoint.octave = 1;
    image::Descriptor descriptor = world.descriptors[i];
    for (int flip = 0; flip < 6; ++flip) descriptor[random.Below(4)] ^= std::uint64_t{1} << random.Below(64);
    features->features.keypoints.push_back(keypoint);
    features->features.descriptors.push_back(descriptor);
    visible->push_back(i);
  }
  keyframe.features = std::move(features);
  return keyframe;
}

// A world of `num_views` cameras, 0.2 apart along x, and points 3 to 6 ahead. The map holds the camera and the session,
// no keyframe.
inline TestMap MakeWorld(std::uint64_t seed, std::size_t num_views, std::size_t num_points) {
  Random random(seed);
  TestMap world;
  MapInfo info;
  info.id = "00000000000000000000000000000001";
  Edit edit(Snapshot::Empty(info));
  world.camera = edit.AddCamera({CameraId(), "camera", Camera::FromPinhole(kPinhole), kPinhole});
  Session session;
  session.camera = world.camera;
  world.session = edit.AddSession(session);
  const auto snapshot = edit.base().Apply(edit.Finish("start"));
  world.snapshot = snapshot.ok() ? *snapshot : nullptr;
  for (std::size_t i = 0; i < num_points; ++i) {
    world.truth.emplace_back(random.Uniform(-3, 5), random.Uniform(-2, 2), random.Uniform(3, 6));
    world.descriptors.push_back(image::testing::RandomDescriptor(random));
  }
  for (std::size_t i = 0; i < num_views; ++i) {
    world.poses.emplace_back(ExpSO3(Vector3d(0, 0.01 * static_cast<double>(i), 0)),
                             Vector3d(-0.2 * static_cast<double>(i), 0, 0));
  }
  return world;
}

// The world as a map: all its cameras as keyframes, a point for everything that at least two of them see.
inline TestMap MakeMap(std::uint64_t seed, std::size_t num_views, std::size_t num_points, double noise_px = 0.0) {
  TestMap world = MakeWorld(seed, num_views, num_points);
  Random random(seed + 1);
  Edit edit(world.snapshot);
  std::vector<std::vector<Observation>> seen(num_points);
  for (std::size_t view = 0; view < num_views; ++view) {
    std::vector<std::size_t> visible;
    const KeyframeId id = edit.AddKeyframe(MakeKeyframe(world, view, noise_px, random, &visible));
    for (std::uint32_t i = 0; i < visible.size(); ++i) seen[visible[i]].push_back({id, i});
  }
  for (std::size_t i = 0; i < num_points; ++i) {
    if (seen[i].size() < 2) continue;
    const PointId point = edit.AddPoint(world.truth[i]);
    for (const Observation& observation : seen[i])
      edit.AddObservation(point, observation.keyframe, observation.feature);
  }
  const auto snapshot = world.snapshot->Apply(edit.Finish("map"));
  world.snapshot = snapshot.ok() ? *snapshot : nullptr;
  return world;
}

}  // namespace cairn::map::testing

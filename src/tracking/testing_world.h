// A world of points with descriptors, cameras that see them with noise, and the map that results: for the tests of
// matching and relocalization, without images.
#pragma once

#include <cmath>
#include <memory>
#include <numbers>
#include <span>
#include <vector>

#include "base/random.h"
#include "image/testing_descriptors.h"
#include "map/edit.h"
#include "place/training.h"
#include "place/vocabulary.h"

namespace cairn::tracking::testing_world {

struct WorldPoint {
  Vector3d position;
  image::Descriptor descriptor;
  double finest_distance = 0.0;  // from which it is a feature of octave 0
};

struct World {
  std::vector<WorldPoint> points;
};

struct View {
  image::Features features;
  std::vector<std::int32_t> point_of_feature;  // index into World::points; -1: clutter
};

struct ViewOptions {
  double pixel_sigma = 0.5;     // at octave 0
  int flipped_bits = 12;        // of 256, per observation
  double detected_share = 0.8;  // of the points in view
  int clutter = 50;             // features that belong to no point
};

inline const Pinhole kPinhole{640, 480, 500.0, 500.0, 319.5, 239.5};

using image::testing::RandomDescriptor;

inline image::Descriptor WithFlippedBits(image::Descriptor descriptor, int count, Random& random) {
  for (int i = 0; i < count; ++i) {
    const std::uint64_t bit = random.Below(256);
    descriptor[bit / 64] ^= std::uint64_t{1} << (bit % 64);
  }
  return descriptor;
}

// Points on the walls of a room 8 wide (x), 4 high (y) and 6 deep (z), its centre at `center`.
inline void AddRoom(const Vector3d& center, int count, Random& random, World* world) {
  const Vector3d half(4.0, 2.0, 3.0);
  for (int i = 0; i < count; ++i) {
    WorldPoint point;
    for (int k = 0; k < 3; ++k) point.position[k] = random.Uniform(-half[k], half[k]);
    const auto axis = static_cast<int>(random.Below(3));
    point.position[axis] = random.Below(2) == 0 ? -half[axis] : half[axis];
    point.position += center;
    point.descriptor = RandomDescriptor(random);
    point.finest_distance = random.Uniform(4.0, 14.0);
    world->points.push_back(point);
  }
}

// A poster on the far wall (+z) of such a room: many points in a square.
inline void AddPoster(const Vector3d& center, double side, int count, Random& random, World* world) {
  for (int i = 0; i < count; ++i) {
    const Vector3d offset(random.Uniform(-0.5, 0.5) * side, random.Uniform(-0.5, 0.5) * side, 3.0);
    world->points.push_back({center + offset, RandomDescriptor(random), random.Uniform(5.0, 12.0)});
  }
}

// camera_from_world of a camera at `center` that is turned to the right by `yaw_rad` from looking along +z.
inline SE3 Look(const Vector3d& center, double yaw_rad) {
  const SE3 world_from_camera(Quaterniond(Eigen::AngleAxisd(yaw_rad, Vector3d::UnitY())), center);
  return world_from_camera.Inverse();
}

inline View Observe(const World& world, const SE3& camera_from_world, const image::OrbParameters& orb,
                    const ViewOptions& options, Random& random, const Pinhole& pinhole = kPinhole) {
  View view;
  const auto add = [&](const Vector2d& pixel, int octave, const image::Descriptor& descriptor, std::int32_t point) {
    const double sigma = options.pixel_sigma * orb.Scale(octave);
    image::Keypoint keypoint;
    keypoint.x_px = static_cast<float>(pixel.x() + sigma * random.Normal());
    keypoint.y_px = static_cast<float>(pixel.y() + sigma * random.Normal());
    keypoint.octave = static_cast<std::uint8_t>(octave);
    keypoint.angle_rad = point < 0 ? static_cast<float>(random.Uniform(-3.1, 3.1))
                                   : static_cast<float>(0.1 * random.Normal() + std::sin(0.37 * point));
    view.features.keypoints.push_back(keypoint);
    view.features.descriptors.push_back(descriptor);
    view.point_of_feature.push_back(point);
  };
  for (std::size_t i = 0; i < world.points.size(); ++i) {
    const WorldPoint& point = world.points[i];
    const Vector3d point_c = camera_from_world * point.position;
    if (point_c.z() < 0.2 || random.Uniform() > options.detected_share) continue;
    const Vector2d pixel = pinhole.Project(point_c);
    const double level = std::log(point.finest_distance / point_c.norm()) / std::log(orb.scale_factor);
    if (!pinhole.Contains(pixel, 2.0) || level < -0.5 || level > orb.num_levels - 0.5) continue;
    add(pixel, static_cast<int>(std::round(level)), WithFlippedBits(point.descriptor, options.flipped_bits, random),
        static_cast<std::int32_t>(i));
  }
  for (int i = 0; i < options.clutter; ++i) {
    add({random.Uniform(5, pinhole.width_px - 5), random.Uniform(5, pinhole.height_px - 5)},
        static_cast<int>(random.Below(4)), RandomDescriptor(random), -1);
  }
  return view;
}

// A vocabulary of the descriptors of a world.
inline std::shared_ptr<const place::Vocabulary> TrainVocabulary(const World& world) {
  std::vector<place::ImageDescriptors> images;
  for (std::size_t i = 0; i < world.points.size(); ++i) {
    if (i % 100 == 0) images.emplace_back();
    images.back().push_back(world.points[i].descriptor);
  }
  place::TrainingOptions options;
  options.branching = 5;
  options.depth = 4;
  return std::make_shared<const place::Vocabulary>(*place::Train(images, options));
}

// The map of keyframes at these poses, with every point that two or more of them see, at its true position. A point
// that more than `max_unseen` keyframes in a row have not seen comes back as another one: to a camera that does not
// know the place again. Of two or more components, all but the first begin at the poses of these indices.
inline std::shared_ptr<const map::Snapshot> BuildMap(const World& world, const std::vector<SE3>& poses,
                                                     const place::Vocabulary& vocabulary, const ViewOptions& options,
                                                     Random& random, KeyframeId::Value max_unseen = 1000000,
                                                     const std::vector<std::size_t>& components_at = {}) {
  map::MapInfo info;
  info.id = "0123456789abcdef0123456789abcdef";
  info.vocabulary_hash = vocabulary.hash();
  auto snapshot = map::Snapshot::Empty(info);
  map::Edit edit(snapshot);
  map::MapCamera camera;
  camera.model = Camera::FromPinhole(kPinhole);
  camera.pinhole = kPinhole;
  map::Keyframe keyframe;
  keyframe.camera = edit.AddCamera(camera);
  map::Session session;
  session.camera = keyframe.camera;
  keyframe.session = edit.AddSession(session);
  std::vector<std::vector<map::Observation>> observations(world.points.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const SE3& pose = poses[i];
    if (std::ranges::find(components_at, i) != components_at.end()) {
      keyframe.component = edit.AddComponent({.id = {}, .session = keyframe.session});
    }
    View view = Observe(world, pose, info.orb, options, random);
    auto features = std::make_shared<map::KeyframeFeatures>();
    for (const auto& descriptor : view.features.descriptors) features->words.push_back(vocabulary.Lookup(descriptor));
    features->features = std::move(view.features);
    keyframe.camera_from_map = pose;
    // As an odometry has it, which two runs do not share: off by what the noise of the view comes to.
    const auto& seen = features->features.keypoints;
    Vector3d off = Vector3d::Zero();
    if (!seen.empty()) off = 1e-6 * Vector3d(seen[0].x_px, seen[0].y_px, 0.0);
    keyframe.camera_from_direct = SE3(Quaterniond::Identity(), off) * pose;
    keyframe.features = features;
    const KeyframeId id = edit.AddKeyframe(keyframe);
    for (std::uint32_t k = 0; k < view.point_of_feature.size(); ++k) {
      if (view.point_of_feature[k] >= 0) {
        observations[static_cast<std::size_t>(view.point_of_feature[k])].push_back({id, k});
      }
    }
  }
  for (std::size_t i = 0; i < observations.size(); ++i) {
    for (std::span<const map::Observation> left = observations[i]; !left.empty();) {
      std::size_t count = 1;
      while (count < left.size() && left[count].keyframe.value() - left[count - 1].keyframe.value() <= max_unseen + 1) {
        ++count;
      }
      if (count >= 2) {
        const PointId id = edit.AddPoint(world.points[i].position);
        for (const map::Observation& o : left.first(count)) edit.AddObservation(id, o.keyframe, o.feature);
      }
      left = left.subspan(count);
    }
  }
  return *snapshot->Apply(edit.Finish("test world"));
}

// Keyframes on a path along a room, looking at its far wall and partly aside.
inline std::vector<SE3> PathInRoom(const Vector3d& center, int count) {
  std::vector<SE3> poses;
  for (int i = 0; i < count; ++i) {
    const double s = count > 1 ? static_cast<double>(i) / (count - 1) : 0.5;
    poses.push_back(Look(center + Vector3d(-2.0 + 4.0 * s, 0.1 * std::sin(5 * s), -2.0), 0.5 * std::sin(7.0 * s)));
  }
  return poses;
}

inline double CenterError(const SE3& a, const SE3& b) {
  return (a.Inverse().translation() - b.Inverse().translation()).norm();
}
inline double RotationErrorDeg(const SE3& a, const SE3& b) {
  return AngleRad((a * b.Inverse()).rotation()) * 180.0 / std::numbers::pi;
}

}  // namespace cairn::tracking::testing_world

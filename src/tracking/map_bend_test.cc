#include "tracking/map_bend.h"

#include <gtest/gtest.h>

#include <functional>
#include <memory>

#include "base/random.h"
#include "map/edit.h"
#include "tracking/testing_world.h"

namespace cairn::tracking {
namespace {

constexpr int kPoints = 40;

struct Poses {
  SE3 camera_from_map, camera_from_direct;
  std::int64_t segment = 0;
};

// Ten keyframes on an arc, a second apart, which all see the same points: one after `begin`.
std::shared_ptr<const map::Snapshot> MapOf(const std::function<Poses(int)>& poses,
                                           std::vector<map::ClosedLoop> loops = {}) {
  map::MapInfo info;
  info.id = "0123456789abcdef0123456789abcdef";
  auto snapshot = map::Snapshot::Empty(info);
  map::Edit edit(snapshot);
  map::MapCamera camera;
  camera.model = Camera::FromPinhole(testing_world::kPinhole);
  camera.pinhole = testing_world::kPinhole;
  map::Keyframe keyframe;
  keyframe.camera = edit.AddCamera(camera);
  map::Session session;
  session.camera = keyframe.camera;
  session.loops = std::move(loops);
  keyframe.session = edit.AddSession(session);
  Random random(3);
  auto features = std::make_shared<map::KeyframeFeatures>();
  for (int i = 0; i < kPoints; ++i) {
    features->features.keypoints.emplace_back();
    features->features.keypoints.back().x_px = static_cast<float>(10 + i);
    features->features.descriptors.push_back(testing_world::RandomDescriptor(random));
  }
  keyframe.features = features;
  std::vector<KeyframeId> ids;
  for (int k = 0; k < 10; ++k) {
    const Poses pose = poses(k);
    keyframe.camera_from_map = pose.camera_from_map;
    keyframe.camera_from_direct = pose.camera_from_direct;
    keyframe.direct_segment = pose.segment;
    keyframe.time_ns = FromSeconds(k);
    keyframe.frame_index = k;
    ids.push_back(edit.AddKeyframe(keyframe));
  }
  for (std::uint32_t i = 0; i < kPoints; ++i) {
    const PointId point = edit.AddPoint(Vector3d(0.1 * i - 2.0, 0.3, 4.0));
    for (const KeyframeId id : ids) edit.AddObservation(point, id, i);
  }
  return *snapshot->Apply(edit.Finish("ten keyframes"));
}

SE3 OnArc(int k) {
  return SE3(Quaterniond(Eigen::AngleAxisd(0.05 * k, Vector3d::UnitY())),
             Vector3d(0.3 * k, 0.05 * std::sin(k), 0.02 * k * k))
      .Inverse();
}

const Sim3 kDirectFromMap(Quaterniond(Eigen::AngleAxisd(1.1, Vector3d(1, 2, -1).normalized())), Vector3d(4, -2, 1),
                          0.4);

SE3 InDirect(const SE3& camera_from_map) { return kDirectFromMap.TransformPose(camera_from_map.Inverse()).Inverse(); }

TEST(MapBend, IsWhatNoSimilarityTakesAway) {
  const auto same = MapOf([](int k) { return Poses{OnArc(k), InDirect(OnArc(k))}; });
  const MapError none = BendAround(*same, KeyframeId(4));
  EXPECT_LT(none.translation, 1e-9);
  EXPECT_LT(none.rotation_rad, 1e-6);

  // On average over many maps, the noise of the poses.
  Random random(7);
  double translation = 0.0, rotation = 0.0;
  constexpr int kMaps = 100;
  for (int i = 0; i < kMaps; ++i) {
    const auto bent = MapOf([&](int k) {
      Vector6d noise;
      for (int j = 0; j < 6; ++j) noise[j] = (j < 3 ? 0.02 : 0.01) * random.Normal();
      return Poses{SE3::Exp(noise) * OnArc(k), InDirect(OnArc(k))};
    });
    const MapError bend = BendAround(*bent, KeyframeId(4));
    translation += bend.translation * bend.translation / kMaps;
    rotation += bend.rotation_rad * bend.rotation_rad / kMaps;
  }
  EXPECT_NEAR(std::sqrt(translation), 0.02, 0.004);
  EXPECT_NEAR(std::sqrt(rotation), 0.01, 0.001);
}

TEST(MapBend, IsNotKnownWhereThereIsNothingToCompare) {
  const auto bent = [](int k) {
    Poses poses{OnArc(k), InDirect(SE3(Quaterniond::Identity(), Vector3d(0, 0.02 * (k % 2), 0)) * OnArc(k))};
    return poses;
  };
  EXPECT_GT(BendAround(*MapOf(bent), KeyframeId(4)).translation, 0.005);
  EXPECT_EQ(BendAround(*MapOf(bent), KeyframeId(400)).translation, 0.0);
  const auto given = MapOf([&](int k) {
    Poses poses = bent(k);
    poses.segment = -1;
    return poses;
  });
  EXPECT_EQ(BendAround(*given, KeyframeId(4)).translation, 0.0) << "poses were given";
  const auto torn = MapOf([&](int k) {
    Poses poses = bent(k);
    poses.segment = k / 3;
    return poses;
  });
  EXPECT_EQ(BendAround(*torn, KeyframeId(4)).translation, 0.0) << "three keyframes of one start of the odometry";
  const auto still = MapOf([](int) { return Poses{OnArc(0), InDirect(OnArc(0))}; });
  EXPECT_EQ(BendAround(*still, KeyframeId(4)).translation, 0.0);
}

// The odometry has drifted by 0.2 when the place is seen again; the map has not.
TEST(MapBend, IsNotWhatTheOdometryDriftsRoundALoop) {
  const auto drifted = [](int k) {
    return Poses{OnArc(k), InDirect(SE3(Quaterniond::Identity(), Vector3d(0, k < 5 ? 0.0 : 0.2, 0)) * OnArc(k))};
  };
  EXPECT_GT(BendAround(*MapOf(drifted), KeyframeId(4)).translation, 0.03);
  map::ClosedLoop loop;
  loop.keyframe = KeyframeId(6);
  loop.loop_keyframe = KeyframeId(5);
  loop.keyframe_time_ns = FromSeconds(5);
  loop.loop_time_ns = FromSeconds(4);
  const auto closed = MapOf(drifted, {loop});
  EXPECT_LT(BendAround(*closed, KeyframeId(4)).translation, 1e-9);
  EXPECT_LT(BendAround(*closed, KeyframeId(8)).translation, 1e-9);
}

}  // namespace
}  // namespace cairn::tracking

#include "client/local_tracker.h"

#include "client/conformance/tracker_conformance.h"
#include "map/edit.h"
#include "store/sqlite_map_store.h"

namespace cairn::conformance {
namespace {

absl::StatusOr<std::unique_ptr<api::Tracker>> OpenWith(const std::string& path, const Camera& camera,
                                                       client::TrackMode mode, bool deterministic) {
  client::LocalTrackerOptions options;
  options.mode = mode;
  options.deterministic = deterministic;
  options.wait_for_matches = true;  // rendering takes longer than tracking
  options.refresh_interval_s = 0.01;
  return client::LocalTracker::Open(path, camera, options);
}

TrackerCase Case(const std::string& name, client::TrackMode mode, bool deterministic) {
  return {name,
          [=](const std::string& path, const Camera& camera) { return OpenWith(path, camera, mode, deterministic); },
          mode == client::TrackMode::kSemiDirect};
}

INSTANTIATE_TEST_SUITE_P(Local, TrackerConformance,
                         testing::Values(Case("SemiDirect", client::TrackMode::kSemiDirect, false),
                                         Case("SemiDirectInOrder", client::TrackMode::kSemiDirect, true),
                                         Case("Features", client::TrackMode::kFeatures, false)),
                         [](const auto& parameter) { return parameter.param.name; });

TEST(LocalTracker, ErrorsOfTheFileOfTheCameraAndOfOptions) {
  const Camera camera = Camera::FromPinhole(TheConformanceMap().pinhole);
  EXPECT_EQ(client::LocalTracker::Open(testing::TempDir() + "/no_such_map.cairn", camera).status().code(),
            absl::StatusCode::kNotFound);
  client::LocalTrackerOptions options;
  options.match_interval_s = -1.0;
  EXPECT_EQ(client::LocalTracker::Open("any", camera, options).status().code(), absl::StatusCode::kInvalidArgument);
  Camera bad = camera;
  bad.fx_px = 0.0;
  EXPECT_EQ(client::LocalTracker::Open("any", bad).status().code(), absl::StatusCode::kInvalidArgument);
}

// No call takes as long as a relocalization: the answer reaches a later frame.
TEST(LocalTracker, FindsItselfBesideTheCalls) {
  const std::string path = testing::TempDir() + "/local_tracker_test_" + std::to_string(getpid()) + ".cairn";
  std::remove(path.c_str());
  ASSERT_TRUE(WriteConformanceMap(path).ok());
  const ConformanceMap& map = TheConformanceMap();
  client::LocalTrackerOptions options;
  options.relocalize_in_call = false;
  const auto tracker = client::LocalTracker::Open(path, Camera::FromPinhole(map.pinhole), options);
  ASSERT_TRUE(tracker.ok()) << tracker.status();
  const auto pose_at = [](int i) { return LookInRoom({-0.3 + 0.004 * i, 0.0, -1.4}, 0.002 * i); };
  int followed = 0;
  for (int i = 0; i < 300 && followed < 20; ++i) {
    const auto answer = (*tracker)->Track({map.room.Render(map.pinhole, pose_at(i)), 1 + i * 33'333'333LL});
    ASSERT_TRUE(answer.ok()) << answer.status();
    EXPECT_NE(answer->state, api::TrackState::kLocated);
    EXPECT_TRUE(i > 0 || answer->state == api::TrackState::kLost);
    if (answer->state == api::TrackState::kLost) continue;
    ++followed;
    EXPECT_LT((answer->map_from_camera.translation() - pose_at(i).Inverse().translation()).norm(), 0.03);
  }
  EXPECT_EQ(followed, 20);
  std::remove(path.c_str());
}

// What a place becomes when its component is joined to another one, half as large and turned.
TEST(Place, MovesWithItsKeyframeIntoAnotherComponent) {
  const std::shared_ptr<const map::Snapshot> before = TheConformanceMap().snapshot;
  map::Edit edit(before);
  map::Keyframe there = before->keyframe(KeyframeId(1));
  const ComponentId into = edit.AddComponent({.id = {}, .session = there.session});
  there.component = into;
  there.time_ns += 1'000'000;
  map::ComponentJoin join;
  join.into = into;
  join.keyframe = KeyframeId(1);
  join.into_keyframe = edit.AddKeyframe(there);
  join.into_from_component = Sim3(Quaterniond(Eigen::AngleAxisd(0.5, Vector3d::UnitY())), Vector3d(1.0, 2.0, 3.0), 0.5);
  edit.JoinComponent(ComponentId(1), join);
  const auto after = before->Apply(edit.Finish("joined"));
  ASSERT_TRUE(after.ok()) << after.status();

  client::Anchor anchor;
  anchor.place.component = ComponentId(1);
  anchor.place.reference = KeyframeId(4);
  anchor.place.map_from_camera = LookInRoom({0.3, 0.0, -1.3}, 0.1).Inverse();
  anchor.place.median_depth = 3.0;
  anchor.odometer.way = 4.0;
  anchor.covariance = 1e-4 * Matrix6d::Identity();
  double ratio = 0.0;
  const auto moved = client::MoveAnchor(anchor, *before, **after, &ratio);
  ASSERT_TRUE(moved);
  EXPECT_EQ(moved->place.component, into);
  EXPECT_NEAR(ratio, 0.5, 1e-12);
  EXPECT_NEAR(moved->place.median_depth, 1.5, 1e-9);
  EXPECT_NEAR(moved->odometer.way, 2.0, 1e-9);
  const SE3 expected = join.into_from_component.TransformPose(anchor.place.map_from_camera);
  EXPECT_LT((moved->place.map_from_camera.translation() - expected.translation()).norm(), 1e-9);
  EXPECT_LT(AngleRad((moved->place.map_from_camera * expected.Inverse()).rotation()), 1e-9);
  // As sure as before, in the camera's own frame.
  const auto local = [](const client::Anchor& a) {
    const Matrix6d adjoint = a.place.map_from_camera.Inverse().Adjoint();
    return Matrix6d(adjoint * a.covariance * adjoint.transpose());
  };
  EXPECT_NEAR(local(*moved)(0, 0), 0.25 * local(anchor)(0, 0), 1e-12);
  EXPECT_NEAR(local(*moved)(4, 4), local(anchor)(4, 4), 1e-12);

  anchor.place.reference = KeyframeId(4000);
  EXPECT_FALSE(client::MoveAnchor(anchor, *before, **after, &ratio)) << "what it was matched with is gone";
}

TEST(Anchor, UncertaintyGrowsWithTheWay) {
  client::Anchor anchor;
  anchor.place.median_depth = 2.0;
  anchor.inliers = 200;
  client::Odometer now;
  double variance = 0.0;
  for (int i = 0; i < 5; ++i) {
    const Matrix6d covariance =
        client::CovarianceOf(anchor, SE3(), client::SigmaSince(anchor, now, {}), client::DriftOptions());
    EXPECT_GT(covariance(0, 0), variance);
    variance = covariance(0, 0);
    now.Add(SE3(Quaterniond::Identity(), Vector3d(1.0, 0.0, 0.0)), 1.0);
  }
}

}  // namespace
}  // namespace cairn::conformance

#include "client/local_tracker.h"

#include "client/conformance/tracker_conformance.h"
#include "client/map_reader.h"
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

client::Anchor AnchorAt(const Vector3d& place, double noise) {
  client::Anchor anchor;
  anchor.place.map_from_camera = SE3(Quaterniond::Identity(), place);
  anchor.place.median_depth = 2.0;
  anchor.noise_variance = noise * noise;
  return anchor;
}

TEST(Anchor, LiesBetweenWhatWasCarriedOnAndTheMatch) {
  const client::Anchor before = AnchorAt({0.0, 0.0, 0.0}, 0.001);
  const SE3 carried(Quaterniond::Identity(), Vector3d(1.0, 0.0, 0.0));
  const auto blended = [&](double drift) {
    client::Anchor match = AnchorAt({1.004, 0.0, 0.0}, 0.001);
    EXPECT_GT(client::Blend(before, carried, {2.0 * drift, 0.0}, &match), 0.0);
    EXPECT_LT(match.noise_variance, 1e-6) << "both together are surer than the match";
    return match.place.map_from_camera.translation().x();
  };
  EXPECT_NEAR(blended(0.0), 1.002, 1e-9);
  EXPECT_NEAR(blended(0.001), 1.0 + 0.004 * 2.0 / 3.0, 1e-9);
  EXPECT_GT(blended(0.1), 1.0039) << "after a long way the match counts alone";

  client::Anchor far = AnchorAt({1.1, 0.0, 0.0}, 0.001);
  EXPECT_GT(client::Blend(before, carried, {}, &far), 16.0);
  EXPECT_EQ(far.place.map_from_camera.translation().x(), 1.1) << "nor with a way that does not explain it";
}

TEST(Anchor, LearnsHowMuchTheOdometryDrifts) {
  client::Drift poor, good;
  for (int i = 0; i < 100; ++i) poor.Learn(4.0), good.Learn(0.2);
  EXPECT_GT(poor.factor(), 2.0);
  EXPECT_LT(good.factor(), 0.7);
  for (int i = 0; i < 1000; ++i) poor.Learn(1e9), good.Learn(0.0);
  EXPECT_LE(poor.factor(), 4.0);
  EXPECT_GE(good.factor(), 0.5);
  for (int i = 0; i < 1000; ++i) good.Learn(9.0);
  EXPECT_EQ(good.factor(), poor.factor()) << "and forgets";
}

class LocalTrackerOfAMap : public testing::Test {
 protected:
  void SetUp() override {
    path_ = testing::TempDir() + "/local_tracker_of_" + std::to_string(getpid()) + ".cairn";
    std::remove(path_.c_str());
    ASSERT_TRUE(WriteConformanceMap(path_).ok());
  }
  void TearDown() override { std::remove(path_.c_str()); }
  cv::Mat ImageAt(int i) const {
    return map_.room.Render(map_.pinhole, LookInRoom({-0.3 + 0.004 * i, 0.0, -1.4}, 0.0));
  }

  const ConformanceMap& map_ = TheConformanceMap();
  const Camera camera_ = Camera::FromPinhole(map_.pinhole);
  std::string path_;
};

TEST_F(LocalTrackerOfAMap, TrackersShareWhatAReaderHasLoaded) {
  const auto reader = client::MapReader::Open(path_);
  ASSERT_TRUE(reader.ok()) << reader.status();
  const std::unique_ptr<client::ViewSource> another = (*reader)->Another();
  EXPECT_EQ(another->view(), (*reader)->view());
  auto tracker = client::LocalTracker::Open((*reader)->Another(), camera_);
  ASSERT_TRUE(tracker.ok()) << tracker.status();
  EXPECT_EQ(&(*tracker)->snapshot(), &(*reader)->view()->map());
  {
    auto store = store::OpenMapStore(path_, store::OpenMode::kWrite);
    ASSERT_TRUE(store.ok()) << store.status();
    map::Edit edit(*(*store)->LoadSnapshot());
    edit.AddComponent({.id = {}, .session = SessionId(1)});
    ASSERT_TRUE((*store)->Commit(edit.Finish("a change")).ok());
  }
  const std::shared_ptr<const tracking::MapView> before = another->view();
  EXPECT_TRUE(*(*reader)->Refresh());
  EXPECT_EQ(another->view(), before) << "each stays where it is until it is asked";
  EXPECT_TRUE(*another->Refresh());
  EXPECT_EQ(another->view(), (*reader)->view()) << "what one has read the others need not";
  EXPECT_FALSE(*another->Refresh());
}

TEST_F(LocalTrackerOfAMap, LooksForItselfOnlyWhileThereIsTime) {
  for (const client::TrackMode mode : {client::TrackMode::kSemiDirect, client::TrackMode::kFeatures}) {
    client::LocalTrackerOptions options;
    options.mode = mode;
    const auto tracker = client::LocalTracker::Open(path_, camera_, options);
    ASSERT_TRUE(tracker.ok()) << tracker.status();
    const auto late = (*tracker)->Track({ImageAt(0), 1, 0.0, [] { return true; }});
    ASSERT_TRUE(late.ok()) << late.status();
    EXPECT_EQ(late->state, api::TrackState::kLost);
    EXPECT_NE(late->reason.find("time"), std::string::npos) << late->reason;
    const auto found = (*tracker)->Track({ImageAt(1), 1'000'000'000, 0.0, [] { return false; }});
    ASSERT_TRUE(found.ok()) << found.status();
    EXPECT_EQ(found->state, api::TrackState::kLocated) << found->reason;
    const auto followed = (*tracker)->Track({ImageAt(2), 1'033'000'000, 0.0, [] { return true; }});
    ASSERT_TRUE(followed.ok()) << followed.status();
    EXPECT_EQ(followed->state, api::TrackState::kTracked) << "which takes no time worth asking for";
  }
}

// A camera whose exposure doubles from one image to the next, and whose corners are dark: what the odometry sees is
// free of both.
TEST_F(LocalTrackerOfAMap, FollowsACalibratedCamera) {
  const cv::Size size(camera_.width_px, camera_.height_px);
  cv::Mat vignette(size, CV_32FC1);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const double r = std::hypot(x - 0.5 * size.width, y - 0.5 * size.height) / size.width;
      vignette.at<float>(y, x) = static_cast<float>(1.0 - r * r);
    }
  }
  std::vector<double> inverse_response;
  for (int i = 0; i < 256; ++i) inverse_response.push_back(std::pow(i / 255.0, 2.2));
  client::LocalTrackerOptions options;
  options.deterministic = true;
  options.photometric = *image::PhotometricCalibration::Create(inverse_response, vignette);
  const auto tracker = client::LocalTracker::Open(path_, camera_, options);
  ASSERT_TRUE(tracker.ok()) << tracker.status();
  for (int i = 0; i < 12; ++i) {
    const double exposure = i % 2 == 0 ? 1.0 : 0.5;
    cv::Mat image = ImageAt(i);
    for (int y = 0; y < size.height; ++y) {
      for (int x = 0; x < size.width; ++x) {
        auto& gray = image.at<std::uint8_t>(y, x);
        const double light = gray / 255.0 * exposure * vignette.at<float>(y, x);
        gray = cv::saturate_cast<std::uint8_t>(255.0 * std::pow(light, 1.0 / 2.2));
      }
    }
    const auto answer = (*tracker)->Track({image, 1 + i * 33'333'333LL, 0.01 * exposure});
    ASSERT_TRUE(answer.ok()) << answer.status();
    ASSERT_EQ(answer->state, i == 0 ? api::TrackState::kLocated : api::TrackState::kTracked) << i << answer->reason;
    EXPECT_LT((answer->map_from_camera.translation() - Vector3d(-0.3 + 0.004 * i, 0.0, -1.4)).norm(), 0.03) << i;
  }
  options.photometric = *image::PhotometricCalibration::Create(inverse_response, vignette(cv::Rect(0, 0, 20, 20)));
  EXPECT_EQ(client::LocalTracker::Open(path_, camera_, options).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace cairn::conformance

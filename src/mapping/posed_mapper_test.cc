#include "mapping/posed_mapper.h"

#include <gtest/gtest.h>

#include <functional>

#include "mapping/testing_head.h"
#include "mapping/testing_room.h"

namespace cairn::mapping {
namespace {

using testing::CirclePose;
using testing::kRoomPinhole;
using testing::Room;

struct TestRun {
  std::unique_ptr<testing::TestHead> head;
  std::unique_ptr<PosedMapper> mapper;

  explicit TestRun(PosedMapperOptions options) {
    options.features_per_image = 500;
    map::MapInfo info;
    info.id = std::string(32, '1');
    head = std::make_unique<testing::TestHead>(map::Snapshot::Empty(info));
    map::Edit edit(head->map());
    const CameraId camera =
        edit.AddCamera({CameraId(), "camera", Camera::FromPinhole(kRoomPinhole), kRoomPinhole});
    map::Session added;
    added.camera = camera;
    const SessionId session = edit.AddSession(added);
    EXPECT_TRUE(head->Commit(edit.Finish("session"), {}).ok());
    auto made = PosedMapper::Create(options, head.get(), session, camera);
    EXPECT_TRUE(made.ok()) << made.status();
    if (made.ok()) mapper = std::move(*made);
  }

  const std::shared_ptr<const map::Snapshot>& map() const { return head->map(); }
};

// How far a point of the map is from the nearest wall.
double WallDistance(const Room& room, const Vector3d& point) {
  return (room.half.cwiseAbs() - point.cwiseAbs()).cwiseAbs().minCoeff();
}

void CheckMap(const Room& room, const TestRun& run, const PosedMapperReport& report, int keyframes) {
  EXPECT_TRUE(run.map()->CheckConsistency().ok()) << run.map()->CheckConsistency();
  EXPECT_EQ(report.keyframes, keyframes);
  EXPECT_EQ(static_cast<std::size_t>(report.points), run.map()->points().size());
  EXPECT_GT(report.points, 800);
  EXPECT_GT(report.observations, 2.5 * report.points);
  // With 1 degree of parallax and a focal length of 220 px, half a pixel is 0.4 m at the wall: few points are far off.
  int off = 0, far_off = 0;
  run.map()->points().ForEach([&](const std::shared_ptr<const map::MapPoint>& point) {
    off += WallDistance(room, point->position) > 0.1 ? 1 : 0;
    far_off += WallDistance(room, point->position) > 0.5 ? 1 : 0;
  });
  EXPECT_LT(off, 0.15 * report.points);
  EXPECT_LT(far_off, 0.02 * report.points);
}

TEST(PosedMapper, MapsViewsWithGivenPoses) {
  const Room room;
  Random random(3);
  TestRun run{PosedMapperOptions{}};
  constexpr int kViews = 20;
  for (int i = 0; i < kViews; ++i) {
    const SE3 pose = CirclePose(i / 40.0, 1.0);
    const SE3 given(ExpSO3(5e-4 * Vector3d(random.Normal(), random.Normal(), random.Normal())) * pose.rotation(),
                    pose.translation() + 0.002 * Vector3d(random.Normal(), random.Normal(), random.Normal()));
    ASSERT_TRUE(run.mapper->Add({i, i * 1000000000ll, room.Render(pose), given}).ok());
  }
  const auto report = run.mapper->Finish();
  ASSERT_TRUE(report.ok()) << report.status();
  CheckMap(room, run, *report, kViews);
  EXPECT_LT(report->rmse_px, 1.2);
  EXPECT_GT(report->median_pose_change, 0.0);
  EXPECT_LT(report->median_pose_change, 0.01);
  ASSERT_EQ(run.map()->LiveComponents().size(), 1u);
  ASSERT_TRUE(run.map()->WorldFrom(run.map()->LiveComponents()[0]));
  EXPECT_EQ(run.map()->WorldFrom(run.map()->LiveComponents()[0])->scale(), 1.0);
  EXPECT_EQ(run.mapper->Finish().status().code(), absl::StatusCode::kFailedPrecondition);
}

TEST(PosedMapper, LeavesExactPosesAlone) {
  const Room room;
  PosedMapperOptions options;
  options.position_sigma_share = options.rotation_sigma_deg = 0.0;
  TestRun run{options};
  for (int i = 0; i < 10; ++i) {
    ASSERT_TRUE(
        run.mapper->Add({i, i * 1000000000ll, room.Render(CirclePose(i / 40.0, 1.0)), CirclePose(i / 40.0, 1.0)}).ok());
  }
  // A view of nothing that the others see: it has no place in the map.
  Room blank;
  blank.blank_from_rad = -4.0;
  blank.blank_to_rad = 4.0;
  ASSERT_TRUE(run.mapper->Add({10, 10000000000ll, blank.Render(CirclePose(0.3, 1.0)), CirclePose(0.3, 1.0)}).ok());
  const auto report = run.mapper->Finish();
  ASSERT_TRUE(report.ok()) << report.status();
  CheckMap(room, run, *report, 10);
  EXPECT_EQ(report->keyframes_without_points, 1);
  EXPECT_EQ(report->median_pose_change, 0.0);
}

// Views along an arc that the mapper is given with the poses that `pose_of` makes.
absl::StatusOr<PosedMapperReport> MapWith(const std::function<SE3(int)>& pose_of) {
  const Room room;
  TestRun run{PosedMapperOptions{}};
  for (int i = 0; i < 12; ++i) {
    EXPECT_TRUE(run.mapper->Add({i, i * 1000000000ll, room.Render(CirclePose(i / 40.0, 1.0)), pose_of(i)}).ok());
  }
  auto report = run.mapper->Finish();
  EXPECT_EQ(run.map()->keyframes().empty(), !report.ok()) << "nothing of a refused map";
  return report;
}

TEST(PosedMapper, RefusesPosesThatAreNotThoseOfTheImages) {
  const auto right = MapWith([](int i) { return CirclePose(i / 40.0, 1.0); });
  ASSERT_TRUE(right.ok()) << right.status();
  EXPECT_GT(right->fit.share, 0.7);
  EXPECT_LT(right->fit.inverted_share, 0.2);

  const auto inverted = MapWith([](int i) { return CirclePose(i / 40.0, 1.0).Inverse(); });
  EXPECT_EQ(inverted.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_NE(inverted.status().message().find("camera_from_world"), absl::string_view::npos) << inverted.status();

  const auto shuffled = MapWith([](int i) { return CirclePose(i * 7 % 12 / 40.0, 1.0); });
  EXPECT_EQ(shuffled.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(shuffled.status().message().find("camera_from_world"), absl::string_view::npos) << shuffled.status();
}

// A calibration of the camera against the body that is off by 2 degrees turns all poses alike.
TEST(PosedMapper, AConstantErrorOfTheOrientationIsNoReasonToRefuse) {
  const SE3 off(ExpSO3(Vector3d(0.02, 0.02, -0.02)), Vector3d(0.01, 0.0, 0.0));
  const auto report = MapWith([&](int i) { return CirclePose(i / 40.0, 1.0) * off; });
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_GT(report->fit.share, 0.5);
}

TEST(PosedMapper, RefusesBadInput) {
  TestRun run{PosedMapperOptions{}};
  EXPECT_EQ(run.mapper->Add({0, 0, cv::Mat(10, 10, CV_8UC1), SE3()}).status().code(),
            absl::StatusCode::kInvalidArgument);
  const SE3 bad(Quaterniond::Identity(), Vector3d(std::nan(""), 0, 0));
  EXPECT_EQ(run.mapper->Add({0, 0, Room().Render(SE3()), bad}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(run.mapper->Add({0, 0, Room().Render(SE3()), SE3()}).ok());
  EXPECT_EQ(run.mapper->Finish().status().code(), absl::StatusCode::kFailedPrecondition) << "one view makes no map";
  EXPECT_TRUE(run.map()->keyframes().empty());
  PosedMapperOptions options;
  options.rotation_sigma_deg = 0.0;
  EXPECT_EQ(options.Validate().code(), absl::StatusCode::kInvalidArgument) << "exact or not, but not half";
}

}  // namespace
}  // namespace cairn::mapping

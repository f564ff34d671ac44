#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>

#include "base/random.h"
#include "eval/ate.h"
#include "eval/localization.h"
#include "eval/loop.h"
#include "eval/reference.h"
#include "eval/rpe.h"
#include "eval/statistics.h"
#include "geometry/pose_association.h"

namespace cairn::eval {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// A winding path of `n` poses at 10 Hz.
std::vector<io::StampedPose> Path(int n) {
  std::vector<io::StampedPose> poses;
  for (int i = 0; i < n; ++i) {
    const double u = 0.1 * i;
    poses.push_back({FromSeconds(1e6 + u), SE3(ExpSO3(Vector3d(0.1 * std::sin(u), 0.3 * u, 0.05)),
                                               Vector3d(2 * std::sin(0.5 * u), 0.3 * std::cos(u), 0.8 * u))});
  }
  return poses;
}

std::vector<io::StampedPose> Moved(const Sim3& a_from_b, std::vector<io::StampedPose> poses) {
  for (auto& p : poses) p.world_from_camera = a_from_b.TransformPose(p.world_from_camera);
  return poses;
}

const Sim3 kMove(ExpSO3(Vector3d(0.3, -0.9, 1.4)), Vector3d(5, 6, -7), 0.4);

TEST(Statistics, KnownValues) {
  const std::vector<double> v = {4, 1, 3, 2};
  const Statistics s = Summarize(v);
  EXPECT_EQ(s.count, 4);
  EXPECT_DOUBLE_EQ(s.mean, 2.5);
  EXPECT_DOUBLE_EQ(s.median, 2.5);
  EXPECT_DOUBLE_EQ(s.rmse, std::sqrt(7.5));
  EXPECT_DOUBLE_EQ(s.std_dev, std::sqrt(1.25));
  EXPECT_EQ(s.max, 4);
  EXPECT_EQ(Summarize({}).count, 0);
}

TEST(Statistics, FailedRunsCount) {
  const std::vector<absl::StatusOr<double>> runs = {0.3, absl::InternalError("lost"), 0.1, 0.2, 0.4};
  const RunSummary s = SummarizeRuns(runs, 10.0);
  EXPECT_EQ(s.failed, 1);
  EXPECT_DOUBLE_EQ(s.median, 0.3);
  EXPECT_EQ(s.worst, 10.0);
  const std::vector<absl::StatusOr<double>> all(4, absl::InternalError("lost"));
  EXPECT_TRUE(std::isinf(SummarizeRuns(all, INFINITY).median));
}

TEST(Association, NearestEarlierOfEqualAndLimit) {
  const std::vector<io::StampedPose> gt = {{100, {}}, {200, {}}, {300, {}}};
  const std::vector<io::StampedPose> est = {{20, {}}, {90, {}}, {150, {}}, {151, {}}, {320, {}}, {390, {}}};
  const auto pairs = AssociateNearest(est, gt, 60e-9);
  ASSERT_EQ(pairs.size(), 4u);
  EXPECT_EQ(pairs[0].groundtruth, 0u);
  EXPECT_EQ(pairs[1].groundtruth, 0u);
  EXPECT_EQ(pairs[2].groundtruth, 1u);
  EXPECT_EQ(pairs[3].groundtruth, 2u);
  EXPECT_TRUE(AssociateNearest(est, {}, 1).empty());
}

TEST(Ate, ZeroAfterASimilarityAndKnownAfterNoise) {
  const auto gt = Path(80);
  auto est = Moved(kMove.Inverse(), gt);
  auto result = EvaluateAte(est, gt);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_LT(result->position_m.max, 1e-9);
  EXPECT_LT(result->rotation_rad.max, 1e-6);
  EXPECT_NEAR(result->groundtruth_from_estimate.scale(), 0.4, 1e-9);
  EXPECT_EQ(result->position_m.count, 80);
  double length = 0;
  for (int i = 1; i < 80; ++i) {
    length += (gt[i].world_from_camera.translation() - gt[i - 1].world_from_camera.translation()).norm();
  }
  EXPECT_NEAR(result->path_length_m, length, 1e-9);

  // Scale may not be repaired when the alignment is rigid; nothing may when there is none.
  EXPECT_GT(EvaluateAte(est, gt, {.with_scale = false})->position_m.rmse, 0.5);
  est = gt;
  for (auto& p : est) p.world_from_camera.translation() += Vector3d(0.03, 0.04, 0);
  EXPECT_NEAR(EvaluateAte(est, gt, {.align = false})->position_m.rmse, 0.05, 1e-12);
  EXPECT_LT(EvaluateAte(est, gt)->position_m.rmse, 1e-9);
}

TEST(Ate, OrderAndGapsInTheGroundTruth) {
  auto gt = Path(60);
  auto est = Moved(kMove, gt);
  std::swap(est[3], est[40]);
  gt[10].world_from_camera.translation().x() = kNan;
  gt.erase(gt.begin() + 20);
  const auto result = EvaluateAte(est, gt);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->position_m.count, 58);
  EXPECT_EQ(result->estimated, 60);
  EXPECT_LT(result->position_m.max, 1e-9);
}

TEST(Ate, BadInput) {
  const auto gt = Path(30);
  EXPECT_EQ(EvaluateAte({}, gt).status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(EvaluateAte(gt, {}).status().code(), absl::StatusCode::kFailedPrecondition);
  auto late = gt;
  for (auto& p : late) p.time_ns += FromSeconds(1e4);
  EXPECT_NE(EvaluateAte(late, gt).status().message().find("clock"), std::string::npos);
  EXPECT_EQ(EvaluateAte(gt, gt, {.max_dt_s = -1}).status().code(), absl::StatusCode::kInvalidArgument);
  std::vector<io::StampedPose> still(10, gt[0]);
  for (int i = 0; i < 10; ++i) still[i].time_ns = gt[i].time_ns;
  EXPECT_FALSE(EvaluateAte(still, gt).ok());
}

// Of a path on a line the roll about it is open in the positions; the orientations show it.
TEST(Ate, RotationOfAStraightDriveIsThatOfItsOrientations) {
  Random random(3);
  std::vector<io::StampedPose> gt;
  for (int i = 0; i < 60; ++i) {
    const Vector3d at(0.001 * random.Normal(), 0.001 * random.Normal(), 0.2 * i);
    gt.push_back({FromSeconds(0.1 * i), SE3(ExpSO3({0.002 * random.Normal(), 0.002 * random.Normal(), 0}), at)});
  }
  auto est = Moved(kMove, gt);
  for (auto& p : est) p.world_from_camera.translation() += 0.01 * Vector3d(random.Normal(), random.Normal(), 0);
  const auto result = EvaluateAte(est, gt);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->orientations.kind, OrientationKind::kCamera);
  EXPECT_EQ(result->rotation_rad.count, 60);
  EXPECT_LT(result->rotation_rad.max, 0.02);
}

TEST(Ate, OrientationsThatMeanNothingAreNoError) {
  const auto gt = Path(80);
  const auto est = Moved(kMove, gt);
  auto identity = gt;
  for (auto& p : identity) p.world_from_camera = SE3(Quaterniond::Identity(), p.world_from_camera.translation());
  const auto nothing = EvaluateAte(est, identity);
  ASSERT_TRUE(nothing.ok()) << nothing.status();
  EXPECT_EQ(nothing->orientations.kind, OrientationKind::kConstant);
  EXPECT_EQ(nothing->rotation_rad.count, 0);
  EXPECT_NE(Describe(nothing->orientations).find("mean nothing"), std::string::npos);
  EXPECT_LT(nothing->position_m.max, 1e-9);

  auto body = gt;
  const SE3 camera_from_body(ExpSO3({0.2, -1.4, 0.3}), Vector3d::Zero());
  for (auto& p : body) p.world_from_camera = p.world_from_camera * camera_from_body;
  const auto turned = EvaluateAte(est, body);
  ASSERT_TRUE(turned.ok()) << turned.status();
  EXPECT_EQ(turned->orientations.kind, OrientationKind::kBody);
  EXPECT_LT(turned->rotation_rad.max, 1e-4);
  EXPECT_NE(Describe(turned->orientations).find("body"), std::string::npos);
  const auto in_place = EvaluateAte(gt, body, {.align = false});
  ASSERT_TRUE(in_place.ok());
  EXPECT_LT(in_place->rotation_rad.max, 1e-4);
}

TEST(Rpe, ABodysOrientationsAreTurnedToTheCameras) {
  const auto gt = Path(80);
  auto body = gt;
  for (auto& p : body) p.world_from_camera = p.world_from_camera * SE3(ExpSO3({0.2, -1.4, 0.3}), Vector3d::Zero());
  const auto result = EvaluateRpe(Moved(kMove, gt), body);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->orientations.kind, OrientationKind::kBody);
  EXPECT_LT(result->per_delta[0].translation_m.max, 1e-3);
  EXPECT_LT(result->per_delta[0].rotation_rad.max, 1e-4);
  auto identity = gt;
  for (auto& p : identity) p.world_from_camera = SE3(Quaterniond::Identity(), p.world_from_camera.translation());
  const auto nothing = EvaluateRpe(Moved(kMove, gt), identity);
  ASSERT_TRUE(nothing.ok()) << nothing.status();
  EXPECT_LT(nothing->per_delta[0].translation_m.max, 1e-6);
  EXPECT_GT(nothing->per_delta[0].segments, 0);
  EXPECT_EQ(nothing->per_delta[0].rotation_rad.count, 0);
}

// A GPS track of a drive straight ahead: the camera hardly turns, so that orientations that are all the same agree with
// it.
TEST(Rpe, ADriveStraightAheadHasNoOrientationsInAGpsTrack) {
  Random random(4);
  std::vector<io::StampedPose> gps, est;
  for (int i = 0; i < 100; ++i) {
    const double t = 0.1 * i;
    const Quaterniond wobble = ExpSO3(0.0035 * Vector3d(std::sin(2.0 * t), std::sin(1.3 * t + 1.0), std::sin(2.7 * t)));
    const Vector3d at(0.02 * std::sin(t), 0.01 * std::cos(t), 0.03 * i);
    est.push_back({FromSeconds(t), SE3(wobble, at)});
    const Vector3d noise = 0.05 * Vector3d(random.Normal(), random.Normal(), random.Normal());
    gps.push_back({FromSeconds(t), SE3(Quaterniond::Identity(), 10.0 * Vector3d(at.z(), -at.x(), -at.y()) + noise)});
  }
  const auto result = EvaluateRpe(est, gps);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->orientations.kind, OrientationKind::kConstant);
  EXPECT_LT(result->per_delta[0].translation_m.rmse, 0.2) << "the noise of two positions";
  EXPECT_EQ(result->per_delta[0].rotation_rad.count, 0);
}

TEST(Rpe, DriftOfOnePercentInScale) {
  // A path along z whose estimate grows faster and faster: the scale is right on the whole, not in the parts.
  std::vector<io::StampedPose> gt, est;
  for (int i = 0; i <= 100; ++i) {
    const double z = 0.1 * i;
    const Quaterniond nod = ExpSO3({0.3 * std::sin(0.2 * i), 0, 0});
    gt.push_back({FromSeconds(0.1 * i), SE3(nod, {0, 0, z})});
    est.push_back({FromSeconds(0.1 * i), SE3(ExpSO3({0, 0.002 * i, 0}) * nod, {0, 0, 1.01 * z})});
  }
  const auto result = EvaluateRpe(est, gt, {.deltas = {1.0, 2.0, 100.0}, .with_scale = false});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->per_delta[0].segments, 91);
  EXPECT_NEAR(result->per_delta[0].rotation_rad.rmse, 0.02, 1e-6);
  EXPECT_NEAR(result->per_delta[1].rotation_rad.median, 0.04, 1e-6);
  EXPECT_EQ(result->per_delta[2].segments, 0);
  const auto frames = EvaluateRpe(est, gt, {.unit = RpeUnit::kFrames, .deltas = {10}, .with_scale = false});
  EXPECT_NEAR(frames->per_delta[0].translation_m.median, result->per_delta[0].translation_m.median, 1e-9);
  const auto seconds = EvaluateRpe(est, gt, {.unit = RpeUnit::kSeconds, .deltas = {1}, .with_scale = false});
  EXPECT_EQ(seconds->per_delta[0].segments, 91);
  for (std::size_t i = 0; i < est.size(); ++i) {
    est[i].world_from_camera = SE3(gt[i].world_from_camera.rotation(), est[i].world_from_camera.translation());
  }
  const auto straight = EvaluateRpe(est, gt, {.with_scale = false});
  EXPECT_NEAR(straight->per_delta[0].drift_percent, 1.0, 1e-6);
  EXPECT_FALSE(EvaluateRpe(est, gt, {.deltas = {}}).ok());
  EXPECT_FALSE(EvaluateRpe(est, gt, {.deltas = {-1}}).ok());
}

TEST(Rpe, ScaleFromTheAlignment) {
  const auto gt = Path(80);
  const auto result = EvaluateRpe(Moved(kMove, gt), gt);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_LT(result->per_delta[0].translation_m.max, 1e-8);
}

TEST(Loop, KnownDriftBetweenTheEnds) {
  // The estimate of the second half is moved: aligning to the end undoes that move, so the copies differ by it.
  const auto path = Path(200);
  io::Trajectory gt;
  gt.num_rows = 200;
  for (int i = 0; i < 200; ++i) {
    if (i >= 40 && i < 160) continue;
    gt.poses.push_back(path[i]);
    gt.rows.push_back(i);
  }
  const Sim3 drift(Quaterniond::Identity(), Vector3d(0.3, 0, 0.4), 1.0);
  auto est = path;
  for (int i = 100; i < 200; ++i) est[i].world_from_camera = drift.TransformPose(est[i].world_from_camera);
  const auto result = EvaluateLoop(Moved(kMove, est), gt);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_NEAR(result->align_error_m, 0.5, 1e-8);
  EXPECT_EQ(result->start_poses, 40);
  EXPECT_EQ(result->end_poses, 40);
  EXPECT_NEAR(result->scale_drift, 1.0, 1e-9);

  // The same without the empty rows: the gap tells.
  io::Trajectory dense = gt;
  dense.num_rows = 80;
  for (int i = 0; i < 80; ++i) dense.rows[i] = i;
  EXPECT_NEAR(EvaluateLoop(est, dense)->align_error_m, 0.5, 1e-8);

  // Three keyframes in a segment are too few.
  est.resize(163);
  EXPECT_EQ(EvaluateLoop(est, gt).status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_FALSE(EvaluateLoop({}, gt).ok());
  EXPECT_FALSE(EvaluateLoop(est, {}).ok());
}

TEST(Localization, SharesOfAllQueries) {
  const auto reference = Path(10);
  std::vector<LocalizationAnswer> answers;
  for (const auto& p : reference) answers.push_back({p.time_ns, p.world_from_camera});
  answers[0].world_from_camera->translation().x() += 0.04;
  answers[1].world_from_camera->translation().x() += 0.1;
  answers[2].world_from_camera->translation().x() += 0.3;
  answers[3].world_from_camera =
      SE3(ExpSO3({0, 0.3, 0}) * answers[3].world_from_camera->rotation(), answers[3].world_from_camera->translation());
  answers[4].world_from_camera.reset();
  answers[5].world_from_camera->translation().y() = kNan;
  answers.push_back({reference[9].time_ns + FromSeconds(1), SE3()});
  const auto all = EvaluateLocalization(answers, reference);
  ASSERT_TRUE(all.ok()) << all.status();
  EXPECT_EQ(all->queries, 10);
  EXPECT_EQ(all->without_reference, 1);
  EXPECT_EQ(all->answered, 9);
  EXPECT_EQ(all->within, 5);
  EXPECT_EQ(all->wrong, 3);
  EXPECT_DOUBLE_EQ(all->within_share, 0.5);
  EXPECT_DOUBLE_EQ(all->wrong_share, 0.3);
  EXPECT_EQ(all->per_query[1].verdict, LocalizationVerdict::kInaccurate);
  EXPECT_EQ(all->per_query[4].verdict, LocalizationVerdict::kMiss);

  const std::vector<TimeNs> covered = {reference[4].time_ns, reference[0].time_ns + 1000};
  const auto some = EvaluateLocalization(answers, reference, covered);
  EXPECT_EQ(some->queries, 2);
  EXPECT_EQ(some->within, 1);
  EXPECT_EQ(EvaluateLocalization(answers, {}).status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_FALSE(EvaluateLocalization(answers, reference, {}, {.within_m = 1.0}).ok());
}

TEST(Localization, ABodysConstantRotationIsNoError) {
  const auto path = Path(60);
  auto body = path;
  for (auto& p : body) p.world_from_camera = p.world_from_camera * SE3(ExpSO3({0.2, -1.4, 0.3}), Vector3d::Zero());
  std::vector<LocalizationAnswer> answers;
  for (const auto& p : path) answers.push_back({p.time_ns, p.world_from_camera});
  answers[7].world_from_camera = SE3(ExpSO3({0, 0.5, 0}), path[7].world_from_camera.translation());
  const auto result = EvaluateLocalization(answers, body);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->orientations.kind, OrientationKind::kBody);
  EXPECT_EQ(result->within, 59);
  EXPECT_EQ(result->wrong, 1);
  // A map that lies turned in the world is an error, though it turns as it should.
  for (auto& answer : answers) {
    answer.world_from_camera =
        SE3(ExpSO3({0, 0, 0.23}) * answer.world_from_camera->rotation(), answer.world_from_camera->translation());
  }
  EXPECT_EQ(EvaluateLocalization(answers, path)->within, 0);
}

TEST(Reference, TheBodysPlaceOfTheCameraIsAppliedToEurocFilesOnly) {
  const std::filesystem::path folder =
      std::filesystem::path(testing::TempDir()) / ("cairn_reference_" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder / "state_groundtruth_estimate0");
  std::filesystem::create_directories(folder / "cam0");
  const std::string csv = (folder / "state_groundtruth_estimate0" / "data.csv").string();
  std::ofstream(csv) << "#timestamp,x,y,z,qw,qx,qy,qz\n1403715284262142976,1,2,3,0.70710678,0,0,0.70710678\n";
  const std::string tum = (folder / "state_groundtruth_estimate0" / "camera.txt").string();
  std::ofstream(tum) << "1403715284.262142976 1 2 3 0 0 0.70710678 0.70710678\n";

  // Not known where the camera sits.
  auto reference = LoadReference(csv);
  ASSERT_TRUE(reference.ok()) << reference.status();
  EXPECT_TRUE(reference->is_body);
  EXPECT_NE(Describe(*reference).find("--sensor"), std::string::npos);

  const std::string sensor = (folder / "cam0" / "sensor.yaml").string();
  std::ofstream(sensor) << "T_BS:\n  data: [0, 0, 1, 0.5, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 0, 1]\n";
  reference = LoadReference(csv);
  ASSERT_TRUE(reference.ok()) << reference.status();
  ASSERT_TRUE(reference->body_from_camera.has_value());
  // Half a metre along the body's x axis, which points along y of the world.
  EXPECT_LT((reference->trajectory.poses[0].world_from_camera.translation() - Vector3d(1, 2.5, 3)).norm(), 1e-6);
  EXPECT_LT(
      (reference->trajectory.poses[0].world_from_camera.rotation() * Vector3d::UnitZ() - Vector3d::UnitY()).norm(),
      1e-6);
  EXPECT_NE(Describe(*reference).find("sensor.yaml"), std::string::npos);

  EXPECT_FALSE(LoadReference(csv, {.sensor = "none"})->body_from_camera.has_value());
  EXPECT_FALSE(LoadReference(tum)->body_from_camera.has_value());
  EXPECT_TRUE(LoadReference(tum, {.sensor = sensor})->body_from_camera.has_value());
  EXPECT_EQ(LoadReference(tum, {.sensor = tum}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_FALSE(LoadReference(tum, {.sensor = sensor + "x"}).ok());
  std::filesystem::remove_all(folder);
}

TEST(Localization, TimesFile) {
  const std::string path = testing::TempDir() + "/cairn_times_" + std::to_string(::getpid()) + ".txt";
  std::ofstream(path) << "# covered\n20.000000\n\n20.066667 more\n";
  const auto times = ReadTimesFile(path);
  ASSERT_TRUE(times.ok()) << times.status();
  EXPECT_EQ(*times, (std::vector<TimeNs>{20000000000, 20066667000}));
  std::ofstream(path) << "20.0\nabc\n";
  EXPECT_NE(ReadTimesFile(path).status().message().find("line 2"), std::string::npos);
  std::filesystem::remove(path);
  EXPECT_FALSE(ReadTimesFile(path).ok());
}

}  // namespace
}  // namespace cairn::eval

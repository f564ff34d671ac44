// The classes of the public headers.
#include <atomic>
#include <opencv2/imgproc.hpp>
#include <thread>

#include "cairn/conversions.h"
#include "cairn/map.h"
#include "client/boundary/impl.h"
#include "client/boundary/testing_map_file.h"
#include "client/conformance/conformance_map.h"
#include "store/sqlite_map_store.h"

namespace cairn::conformance {
namespace {

using absl::StatusCode;

class PublicMap : public testing::Test {
 protected:
  v0::Map OpenMap() {
    EXPECT_TRUE(WriteConformanceMap(file_.path).ok());
    auto map = v0::Map::Open(file_.path);
    EXPECT_TRUE(map.ok()) << map.status();
    return *map;
  }
  static cv::Mat Image() {
    const ConformanceMap& map = TheConformanceMap();
    return map.room.Render(map.pinhole, LookInRoom({0.2, 0.0, -1.4}, 0.05));
  }
  static v0::Camera CameraOf(const v0::Map& map) { return map.Info()->cameras.at(0).camera; }

  const TestingMapFile file_{"public_map"};
};

TEST_F(PublicMap, SaysWhatItIs) {
  const v0::Map map = OpenMap();
  const auto info = map.Info();
  ASSERT_TRUE(info.ok()) << info.status();
  const map::Snapshot& truth = *TheConformanceMap().snapshot;
  EXPECT_EQ(info->id, truth.info().id);
  EXPECT_EQ(info->name, "conformance");
  EXPECT_EQ(info->revision, 1u);
  EXPECT_EQ(info->keyframes, static_cast<std::int64_t>(truth.keyframes().size()));
  EXPECT_EQ(info->points, static_cast<std::int64_t>(truth.points().size()));
  ASSERT_EQ(info->cameras.size(), 1u);
  EXPECT_EQ(info->cameras[0].name, "cam0");
  EXPECT_EQ(info->cameras[0].camera.width_px, 480);
  EXPECT_EQ(info->cameras[0].camera.fx_px, 350.0);
  EXPECT_TRUE(info->cameras[0].camera.Validate().ok());
  ASSERT_EQ(info->components.size(), 1u);
  EXPECT_TRUE(info->components[0].aligned);
  EXPECT_EQ(info->components[0].world_from_component.scale, 2.0);
  EXPECT_EQ(info->components[0].world_from_component.pose.translation[0], 10.0);
}

TEST_F(PublicMap, ColoursAndStridesAreSeenThrough) {
  const v0::Map map = OpenMap();
  const auto localizer = map.NewLocalizer();
  const cv::Mat gray = Image();
  const auto expected = localizer->Localize({*v0::ViewOf(gray), CameraOf(map)});
  ASSERT_TRUE(expected.ok() && expected->localized);

  cv::Mat color;
  cv::cvtColor(gray, color, cv::COLOR_GRAY2BGR);
  for (const auto format : {v0::PixelFormat::kBgr8, v0::PixelFormat::kRgb8}) {
    const auto answer = localizer->Localize({*v0::ViewOf(color, format), CameraOf(map)});
    ASSERT_TRUE(answer.ok()) << answer.status();
    EXPECT_EQ(answer->map_from_camera.translation, expected->map_from_camera.translation);
  }
  // Another weight of red and blue: the orders are told apart.
  cv::insertChannel(cv::Mat::zeros(color.size(), CV_8UC1), color, 0);
  const auto bgr = localizer->Localize({*v0::ViewOf(color, v0::PixelFormat::kBgr8), CameraOf(map)});
  const auto rgb = localizer->Localize({*v0::ViewOf(color, v0::PixelFormat::kRgb8), CameraOf(map)});
  ASSERT_TRUE(bgr.ok() && rgb.ok());
  EXPECT_NE(bgr->map_from_camera.translation, rgb->map_from_camera.translation);

  cv::Mat wide(gray.rows, gray.cols + 37, CV_8UC1, cv::Scalar(255));
  gray.copyTo(wide.colRange(0, gray.cols));
  const auto strided = localizer->Localize({*v0::ViewOf(wide.colRange(0, gray.cols)), CameraOf(map)});
  ASSERT_TRUE(strided.ok()) << strided.status();
  EXPECT_EQ(strided->map_from_camera.translation, expected->map_from_camera.translation);
  v0::ImageView packed = *v0::ViewOf(gray);
  packed.stride_bytes = 0;
  EXPECT_EQ(localizer->Localize({packed, CameraOf(map)})->map_from_camera.translation,
            expected->map_from_camera.translation);
}

TEST_F(PublicMap, ErrorsAreValues) {
  EXPECT_EQ(v0::Map::Open(testing::TempDir() + "/no_such_map.cairn").status().code(), StatusCode::kNotFound);
  EXPECT_EQ(v0::Map::Open(testing::TempDir()).status().code(), StatusCode::kInvalidArgument);
  const v0::Map map = OpenMap();
  v0::MapOptions options;
  options.num_features = -1;
  EXPECT_EQ(v0::Map::Open(file_.path, options).status().code(), StatusCode::kInvalidArgument);

  const auto localizer = map.NewLocalizer();
  const cv::Mat image = Image();
  const v0::LocalizeQuery good{*v0::ViewOf(image), CameraOf(map)};
  const auto code_of = [&](const v0::LocalizeQuery& query) { return localizer->Localize(query).status().code(); };
  EXPECT_EQ(code_of(good), StatusCode::kOk);
  EXPECT_EQ(code_of({}), StatusCode::kInvalidArgument);
  v0::LocalizeQuery bad = good;
  bad.image.stride_bytes = 479;
  EXPECT_EQ(code_of(bad), StatusCode::kInvalidArgument);
  bad.image.stride_bytes = -480;
  EXPECT_EQ(code_of(bad), StatusCode::kInvalidArgument);
  bad = good;
  bad.image.format = static_cast<v0::PixelFormat>(7);
  EXPECT_EQ(code_of(bad), StatusCode::kInvalidArgument);
  bad = good;
  bad.camera.model = static_cast<v0::CameraModel>(-3);
  EXPECT_EQ(code_of(bad), StatusCode::kInvalidArgument);
  EXPECT_FALSE(bad.camera.Validate().ok());
  bad = good;
  bad.camera.distortion = {0.1};
  EXPECT_EQ(code_of(bad), StatusCode::kInvalidArgument);
}

TEST_F(PublicMap, DeadlinesAndCancellation) {
  const v0::Map map = OpenMap();
  const auto localizer = map.NewLocalizer();
  const cv::Mat image = Image();
  const v0::LocalizeQuery query{*v0::ViewOf(image), CameraOf(map)};
  const auto late = v0::CallOptions::Within(std::chrono::nanoseconds(-1));
  EXPECT_EQ(localizer->Localize(query, late).status().code(), StatusCode::kDeadlineExceeded);
  EXPECT_EQ(map.Refresh(late).status().code(), StatusCode::kDeadlineExceeded);
  EXPECT_EQ(v0::Map::Open(file_.path, {}, late).status().code(), StatusCode::kDeadlineExceeded);
  EXPECT_TRUE(localizer->Localize(query, v0::CallOptions::Within(std::chrono::hours(1)))->localized);

  v0::Cancellation cancellation;
  v0::CallOptions call;
  call.cancellation = &cancellation;
  EXPECT_TRUE(localizer->Localize(query, call).ok());
  cancellation.Cancel();
  EXPECT_EQ(localizer->Localize(query, call).status().code(), StatusCode::kCancelled);
  EXPECT_EQ(map.Refresh(call).status().code(), StatusCode::kCancelled);
  EXPECT_TRUE(localizer->Localize(query).ok());
}

TEST_F(PublicMap, WhatWasMovedFromSaysSo) {
  v0::Map map = OpenMap();
  auto localizer = *map.NewLocalizer();
  const v0::Localizer other = std::move(localizer);
  EXPECT_EQ(localizer.Localize({}).status().code(), StatusCode::kFailedPrecondition);
  const v0::Map taken = std::move(map);
  EXPECT_EQ(map.Info().status().code(), StatusCode::kFailedPrecondition);
  EXPECT_EQ(map.Refresh().status().code(), StatusCode::kFailedPrecondition);
  EXPECT_EQ(map.NewLocalizer().status().code(), StatusCode::kFailedPrecondition);
  EXPECT_EQ(map.NewTracker({}).status().code(), StatusCode::kFailedPrecondition);
}

TEST_F(PublicMap, ManyThreadsLocateWhileTheMapGrows) {
  const ConformanceMap& conformance = TheConformanceMap();
  store::CreateOptions create;
  create.vocabulary = conformance.vocabulary;
  const auto writer = store::SqliteMapStore::Create(file_.path, conformance.snapshot->info(), create);
  ASSERT_TRUE(writer.ok()) << writer.status();
  const auto map = v0::Map::Open(file_.path);
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_FALSE(*map->Refresh());

  const cv::Mat image = Image();
  const v0::LocalizeQuery query{*v0::ViewOf(image), v0::Camera(ToPublicCamera(conformance.pinhole))};
  std::atomic<bool> stop = false;
  std::atomic<int> located = 0, missed = 0, failed = 0;
  std::vector<std::thread> threads;
  for (int i = 0; i < 3; ++i) {
    threads.emplace_back([&, localizer = *map->NewLocalizer()] {
      bool found = false;
      while (!stop && !found) {
        const auto answer = localizer.Localize(query);
        found = answer.ok() && answer->localized;
        ++(!answer.ok() ? failed : found ? located : missed);
      }
    });
  }
  while (missed < 3) std::this_thread::yield();
  EXPECT_TRUE((*writer)->Commit(conformance.delta).ok());
  const auto newer = map->Refresh();
  ASSERT_TRUE(newer.ok()) << newer.status();
  EXPECT_TRUE(*newer);
  EXPECT_EQ(map->Info()->revision, 1u);
  while (located < 3 && failed == 0) std::this_thread::yield();
  stop = true;
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(failed, 0);
}

TEST(Poses, ComposeInvertAndTransformAsEigenDoes) {
  const v0::Pose a_from_b{{1.0, -2.0, 0.5},
                          {0.1825741858350554, 0.3651483716701107, 0.5477225575051661, 0.7302967433402214}};
  const v0::Pose b_from_c{{0.3, 0.2, -0.1}, {0.0, 0.7071067811865476, 0.0, 0.7071067811865476}};
  const Eigen::Isometry3d expected = v0::ToEigen(a_from_b) * v0::ToEigen(b_from_c);
  EXPECT_TRUE(v0::ToEigen(v0::Compose(a_from_b, b_from_c)).isApprox(expected, 1e-12));
  EXPECT_TRUE(v0::ToEigen(v0::Inverse(a_from_b)).isApprox(v0::ToEigen(a_from_b).inverse(), 1e-12));
  EXPECT_TRUE(v0::ToEigen(v0::PoseFromEigen(expected)).isApprox(expected, 1e-12));
  const std::array<double, 3> point = v0::Transform(a_from_b, {{1.0, 2.0, 3.0}});
  EXPECT_LT((Vector3d(point.data()) - v0::ToEigen(a_from_b) * Vector3d(1.0, 2.0, 3.0)).norm(), 1e-12);
  const Eigen::Affine3d scaled = v0::ToEigen(v0::Similarity{a_from_b, 2.0});
  EXPECT_LT(
      (scaled * Vector3d::UnitX() - (2.0 * v0::ToEigen(a_from_b).linear().col(0) + Vector3d(1.0, -2.0, 0.5))).norm(),
      1e-12);
}

// A camera far from the origin whose orientation alone is uncertain about its own place: in a left increment the
// rotation moves it, and the translation moves it back.
TEST(Poses, PositionCovarianceIsAboutTheCamera) {
  v0::Pose pose;
  pose.translation = {100.0, 0.0, 0.0};
  Eigen::Matrix<double, 6, 3> by_turn;  // of the increment, by a turn about the camera
  by_turn << Hat(Vector3d(100.0, 0.0, 0.0)), Matrix3d::Identity();
  const Matrix6d turned = by_turn * (0.01 * 0.01) * by_turn.transpose();
  Matrix6d covariance = turned;
  covariance.topLeftCorner(3, 3) += 0.04 * Matrix3d::Identity();
  v0::PoseCovariance as_array;
  for (int i = 0; i < 36; ++i) as_array[static_cast<std::size_t>(i)] = covariance(i / 6, i % 6);
  EXPECT_NEAR(v0::PositionSigma(pose, as_array), 0.2 * std::sqrt(3.0), 1e-9);
  EXPECT_NEAR(v0::PositionCovariance(pose, as_array)[4], 0.04, 1e-9);
  EXPECT_NEAR(v0::RotationSigmaRad(as_array), 0.01 * std::sqrt(3.0), 1e-9);
  EXPECT_TRUE(v0::ToEigen(as_array).isApprox(covariance));
}

}  // namespace
}  // namespace cairn::conformance

// The test suite of api::Localizer: every implementation passes the same one. Include it in one file of a test binary
// that links cairn::localizer_conformance, and instantiate it with a factory:
//
//   INSTANTIATE_TEST_SUITE_P(Local, LocalizerConformance, testing::Values(LocalizerFactory(&OpenLocal)));
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <functional>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <string>

#include "api/localizer.h"
#include "client/conformance/conformance_map.h"

namespace cairn::conformance {

// Makes a localizer of the map file at `map_path`. It may keep what it needs (a server, say) alive in the localizer.
using LocalizerFactory = std::function<absl::StatusOr<std::unique_ptr<api::Localizer>>(const std::string& map_path)>;

class LocalizerConformance : public testing::TestWithParam<LocalizerFactory> {
 protected:
  void SetUp() override {
    path_ = testing::TempDir() + "/localizer_conformance_" + std::to_string(getpid()) + ".cairn";
    std::remove(path_.c_str());
    ASSERT_TRUE(WriteConformanceMap(path_).ok());
    auto localizer = GetParam()(path_);
    ASSERT_TRUE(localizer.ok()) << localizer.status();
    localizer_ = *std::move(localizer);
  }
  void TearDown() override {
    localizer_.reset();
    std::remove(path_.c_str());
  }

  static api::LocalizeQuery QueryAt(const SE3& camera_from_map) {
    const ConformanceMap& map = TheConformanceMap();
    return {map.room.Render(map.pinhole, camera_from_map), Camera::FromPinhole(map.pinhole), 42};
  }
  static void ExpectPose(const api::LocalizeAnswer& answer, const SE3& camera_from_map) {
    ASSERT_TRUE(answer.localized) << answer.reason;
    const SE3 truth = camera_from_map.Inverse();
    EXPECT_LT((answer.map_from_camera.translation() - truth.translation()).norm(), 0.02);
    EXPECT_LT(AngleRad((answer.map_from_camera * truth.Inverse()).rotation()), 0.01);
  }

  std::string path_;
  std::unique_ptr<api::Localizer> localizer_;
};

TEST_P(LocalizerConformance, FindsTheCameraAndSaysAgainstWhat) {
  const ConformanceMap& map = TheConformanceMap();
  for (int i = 0; i < 3; ++i) {
    const SE3 truth = LookInRoom({-0.9 + 0.8 * i, 0.05, -1.3}, 0.1 * i);
    const auto answer = localizer_->Localize(QueryAt(truth));
    ASSERT_TRUE(answer.ok()) << answer.status();
    ExpectPose(*answer, truth);
    EXPECT_EQ(answer->stage, api::LocalizeStage::kDone);
    EXPECT_EQ(answer->map_id, map.snapshot->info().id);
    EXPECT_EQ(answer->revision, map.snapshot->revision());
    EXPECT_TRUE(map.snapshot->keyframes().Contains(answer->reference_keyframe));
    EXPECT_GE(answer->counts.inliers, 25);
    EXPECT_GE(answer->counts.features, answer->counts.inliers);
    EXPECT_GT(answer->counts.candidates, 0);
    EXPECT_GT(answer->covariance.diagonal().minCoeff(), 0.0);
    EXPECT_LT(answer->covariance.topLeftCorner(3, 3).trace(), 0.05 * 0.05);
  }
}

TEST_P(LocalizerConformance, AnswersInTheWorldOfAnAlignedMap) {
  const SE3 truth = LookInRoom({0.2, 0.0, -1.4}, 0.05);
  const auto answer = localizer_->Localize(QueryAt(truth));
  ASSERT_TRUE(answer.ok()) << answer.status();
  ExpectPose(*answer, truth);
  EXPECT_TRUE(answer->world_is_metric);
  const Vector3d expected = 2.0 * answer->map_from_camera.translation() + Vector3d(10.0, 0.0, 0.0);
  EXPECT_LT((answer->world_from_camera.translation() - expected).norm(), 1e-9);
}

TEST_P(LocalizerConformance, ADistortedCameraOfAnotherSizeIsFine) {
  const Camera camera = AnotherCamera();
  const SE3 truth = LookInRoom({0.0, 0.1, -1.4}, 0.1);
  const auto answer = localizer_->Localize({TheConformanceMap().room.Render(camera, truth), camera, 0});
  ASSERT_TRUE(answer.ok()) << answer.status();
  ExpectPose(*answer, truth);
}

TEST_P(LocalizerConformance, SameQuerySameAnswer) {
  const api::LocalizeQuery query = QueryAt(LookInRoom({0.5, 0.0, -1.4}, -0.1));
  const auto a = localizer_->Localize(query), b = localizer_->Localize(query);
  ASSERT_TRUE(a.ok() && b.ok() && a->localized && b->localized);
  EXPECT_EQ(a->map_from_camera.translation(), b->map_from_camera.translation());
  EXPECT_EQ(a->map_from_camera.rotation().coeffs(), b->map_from_camera.rotation().coeffs());
  EXPECT_EQ(a->counts.inliers, b->counts.inliers);
}

TEST_P(LocalizerConformance, AMissSaysWhy) {
  const ConformanceMap& map = TheConformanceMap();
  api::LocalizeQuery query = QueryAt(LookInRoom({0.0, 0.0, -1.4}, 0.0));
  query.image.setTo(90);
  const auto blank = localizer_->Localize(query);
  ASSERT_TRUE(blank.ok()) << blank.status();
  EXPECT_FALSE(blank->localized);
  EXPECT_EQ(blank->stage, api::LocalizeStage::kFeatures);
  EXPECT_FALSE(blank->reason.empty());
  EXPECT_EQ(blank->counts.features, 0);
  EXPECT_EQ(blank->map_id, map.snapshot->info().id);

  // Another room altogether.
  query.image = RenderedRoom(77).Render(map.pinhole, LookInRoom({0.0, 0.0, -1.4}, 0.0));
  const auto elsewhere = localizer_->Localize(query);
  ASSERT_TRUE(elsewhere.ok()) << elsewhere.status();
  EXPECT_FALSE(elsewhere->localized);
  EXPECT_GE(elsewhere->stage, api::LocalizeStage::kMatches);
  EXPECT_LT(elsewhere->stage, api::LocalizeStage::kDone);
  EXPECT_FALSE(elsewhere->reason.empty());
  EXPECT_GT(elsewhere->counts.features, 100);
}

// Camera of the map, twice as fine: it is found as the map's own is.
TEST_P(LocalizerConformance, ACameraOfTwiceTheResolutionIsFine) {
  const Pinhole& pinhole = TheConformanceMap().pinhole;
  const Pinhole fine{2 * pinhole.width_px, 2 * pinhole.height_px,     2.0 * pinhole.fx_px,
                     2.0 * pinhole.fy_px,  2.0 * pinhole.cx_px + 0.5, 2.0 * pinhole.cy_px + 0.5};
  const SE3 truth = LookInRoom({0.1, 0.0, -1.4}, 0.1);
  cv::Mat image;
  cv::resize(TheConformanceMap().room.Render(pinhole, truth), image, {}, 2.0, 2.0, cv::INTER_CUBIC);
  const auto answer = localizer_->Localize({image, Camera::FromPinhole(fine), 0});
  ASSERT_TRUE(answer.ok()) << answer.status();
  ExpectPose(*answer, truth);
}

TEST_P(LocalizerConformance, APriorNarrowsAndExcludes) {
  const SE3 truth = LookInRoom({0.2, 0.0, -1.4}, 0.05);
  api::LocalizeQuery query = QueryAt(truth);
  // In the world, which is twice as large as the map and begins 10 beside it.
  const SE3 world_from_camera(truth.Inverse().rotation(),
                              2.0 * truth.Inverse().translation() + Vector3d(10.0, 0.0, 0.0));
  query.prior = api::PosePrior{world_from_camera, {}, 0.5, 0.2};
  const auto right = localizer_->Localize(query);
  ASSERT_TRUE(right.ok()) << right.status();
  ExpectPose(*right, truth);

  query.prior = api::PosePrior{truth.Inverse(), ComponentId(1), 0.25, 0.2};
  const auto in_component = localizer_->Localize(query);
  ASSERT_TRUE(in_component.ok()) << in_component.status();
  ExpectPose(*in_component, truth);

  query.prior->map_from_camera =
      SE3(truth.Inverse().rotation(), truth.Inverse().translation() + Vector3d(0.5, 0.0, 0.0));
  query.prior->position_sigma = 0.05;
  const auto wrong = localizer_->Localize(query);
  ASSERT_TRUE(wrong.ok()) << wrong.status();
  EXPECT_FALSE(wrong->localized);
  EXPECT_EQ(wrong->stage, api::LocalizeStage::kRefinement);
  EXPECT_THAT(wrong->reason, testing::HasSubstr("10 standard deviations from the prior"));

  query.prior->component = ComponentId(7);
  EXPECT_EQ(localizer_->Localize(query).status().code(), absl::StatusCode::kInvalidArgument);
  query.prior->component = ComponentId(1);
  query.prior->position_sigma = -1.0;
  EXPECT_EQ(localizer_->Localize(query).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_P(LocalizerConformance, PlacesThatLookAlikeAreNotGuessed) {
  const std::string path = testing::TempDir() + "/localizer_conformance_twins_" + std::to_string(getpid()) + ".cairn";
  std::remove(path.c_str());
  ASSERT_TRUE(WriteConformanceMap(path, TheTwinMap()).ok());
  auto localizer = GetParam()(path);
  ASSERT_TRUE(localizer.ok()) << localizer.status();
  const SE3 truth = LookInRoom({0.2, 0.0, -1.4}, 0.05);
  api::LocalizeQuery query = QueryAt(truth);
  const auto answer = (*localizer)->Localize(query);
  ASSERT_TRUE(answer.ok()) << answer.status();
  EXPECT_FALSE(answer->localized);
  EXPECT_EQ(answer->stage, api::LocalizeStage::kRivals);
  EXPECT_THAT(answer->reason, testing::HasSubstr("look alike"));
  ASSERT_EQ(answer->rivals.size(), 2u);
  EXPECT_NE(answer->rivals[0].component, answer->rivals[1].component);
  EXPECT_GE(answer->rivals[0].inliers, answer->rivals[1].inliers);
  for (const api::LocatedPose& rival : answer->rivals) {
    EXPECT_LT((rival.map_from_camera.translation() - truth.Inverse().translation()).norm(), 0.02);
    EXPECT_TRUE(rival.world_is_metric);
    EXPECT_GT(rival.inliers, 25);
    EXPECT_GT(rival.covariance.diagonal().minCoeff(), 0.0);
  }
  EXPECT_NEAR(
      (answer->rivals[0].world_from_camera.translation() - answer->rivals[1].world_from_camera.translation()).norm(),
      30.0, 0.1);

  // Who knows where it is about is told.
  query.prior = api::PosePrior{answer->rivals[1].world_from_camera, {}, 5.0, 3.0};
  const auto told = (*localizer)->Localize(query);
  ASSERT_TRUE(told.ok()) << told.status();
  ExpectPose(*told, truth);
  EXPECT_EQ(told->component, answer->rivals[1].component);
  localizer->reset();
  std::remove(path.c_str());
}

TEST_P(LocalizerConformance, AFocalLengthThatIsOffIsTold) {
  const SE3 truth = LookInRoom({0.2, 0.0, -1.4}, 0.3);
  api::LocalizeQuery query = QueryAt(truth);
  const auto right = localizer_->Localize(query);
  ASSERT_TRUE(right.ok()) << right.status();
  ExpectPose(*right, truth);
  EXPECT_EQ(right->focal_factor, 1.0);
  query.camera.fx_px *= 1.12;
  query.camera.fy_px *= 1.12;
  const auto off = localizer_->Localize(query);
  ASSERT_TRUE(off.ok()) << off.status();
  ASSERT_TRUE(off->localized) << off->reason;
  EXPECT_NEAR(off->focal_factor, 1.0 / 1.12, 0.02);
  const Vector6d error = (off->map_from_camera * truth).Log();
  EXPECT_LT(error.dot(off->covariance.ldlt().solve(error)), 25.0 * 6.0);
}

TEST_P(LocalizerConformance, BadQueriesAreErrors) {
  const api::LocalizeQuery good = QueryAt(LookInRoom({0.0, 0.0, -1.4}, 0.0));
  api::LocalizeQuery bad = good;
  bad.image = cv::Mat();
  EXPECT_EQ(localizer_->Localize(bad).status().code(), absl::StatusCode::kInvalidArgument);
  bad = good;
  cv::cvtColor(good.image, bad.image, cv::COLOR_GRAY2BGR);
  EXPECT_EQ(localizer_->Localize(bad).status().code(), absl::StatusCode::kInvalidArgument);
  bad = good;
  bad.camera.width_px = 333;
  EXPECT_EQ(localizer_->Localize(bad).status().code(), absl::StatusCode::kInvalidArgument);
  bad = good;
  bad.camera.fx_px = -1.0;
  EXPECT_EQ(localizer_->Localize(bad).status().code(), absl::StatusCode::kInvalidArgument);
  // And it still works.
  EXPECT_TRUE(localizer_->Localize(good).ok());
}

}  // namespace cairn::conformance

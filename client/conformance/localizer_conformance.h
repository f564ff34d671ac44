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

#include "direct/cover_mask.h"

#include <gtest/gtest.h>

#include "direct/alignment_check.h"
#include "direct/testing_scene.h"

namespace cairn::direct {
namespace {

constexpr TimeNs kSecond = 1'000'000'000;

Pinhole Camera() { return testing::TestCamera().Half(); }

// Eight points in each cell of the columns [begin, end); those for which `fails` says so do not fit.
template <typename Fails>
void AddPoints(const Fails& fails, CoverMask* mask) {
  const Pinhole camera = Camera();
  for (int row = 0; row < CoverMask::kRows; ++row) {
    for (int column = 0; column < CoverMask::kColumns; ++column) {
      const float x = (static_cast<float>(column) + 0.5f) * static_cast<float>(camera.width_px) / CoverMask::kColumns;
      const float y = (static_cast<float>(row) + 0.5f) * static_cast<float>(camera.height_px) / CoverMask::kRows;
      for (int i = 0; i < 8; ++i) mask->AddTracked(x, y, !fails(column, row, i));
    }
  }
}

TEST(ViewCells, RegionsCountFromFiveCellsSideBySide) {
  CellSet set = {};
  for (int k : {0, 1, 2, 8, 10}) set[static_cast<std::size_t>(k)] = true;    // a hook of five
  for (int k : {5, 6, 14, 22, 31}) set[static_cast<std::size_t>(k)] = true;  // four, and one at a corner
  for (int k : {39, 47}) set[static_cast<std::size_t>(k)] = true;            // below that corner: three
  const CellSet large = LargeRegions(set);
  for (int k : {0, 1, 2, 8, 10}) EXPECT_TRUE(large[static_cast<std::size_t>(k)]) << k;
  for (int k : {5, 6, 14, 22, 31, 39, 47}) EXPECT_FALSE(large[static_cast<std::size_t>(k)]) << k;
}

TEST(CoverMask, PointsThatCeaseToFitTogetherAreCoveredAndThoseHereAndThereAreNot) {
  CoverMask mask(Camera());
  mask.Begin();
  AddPoints([](int column, int row, int) { return (column + row) % 4 == 0; }, &mask);
  mask.Decide(kSecond);
  EXPECT_FALSE(mask.any());
  mask.Begin();
  AddPoints([](int column, int, int i) { return column < 3 && i < 6; }, &mask);
  mask.Decide(2 * kSecond);
  EXPECT_TRUE(mask.Covered(20.0f, 70.0f));
  EXPECT_FALSE(mask.Covered(120.0f, 70.0f));
  // Everything ceases to fit: that is no obstacle.
  CoverMask other(Camera());
  other.Begin();
  AddPoints([](int, int, int) { return true; }, &other);
  other.Decide(kSecond);
  EXPECT_FALSE(other.any());
}

TEST(CoverMask, IsFreeAgainWhenPointsFitOrAfterASecondWithoutASign) {
  CoverMask mask(Camera());
  mask.Begin();
  AddPoints([](int column, int, int) { return column < 3; }, &mask);
  mask.Decide(kSecond);
  mask.Begin();
  mask.Decide(kSecond + kSecond / 2);  // nothing is known
  EXPECT_TRUE(mask.Covered(20.0f, 70.0f));
  CoverMask fitting = mask;
  fitting.Begin();
  AddPoints([](int, int, int) { return false; }, &fitting);
  fitting.Decide(kSecond + 3 * kSecond / 4);
  EXPECT_FALSE(fitting.any());
  mask.Begin();
  mask.Decide(3 * kSecond);
  EXPECT_FALSE(mask.any());
}

// The right half of two images is the same although the camera turned.
TEST(CoverMask, WhatStaysInTheImageWhileTheCameraTurnsIsCovered) {
  const Pinhole camera = testing::TestCamera();
  const PyramidGeometry geometry = PyramidGeometry::Make(camera, false, 6, 400);
  const testing::Scene scene;
  const SE3 turn(ExpSO3(Vector3d(0.0, 0.04, 0.0)), Vector3d::Zero());
  Frame first = scene.Render(camera, SE3(), 0), second = scene.Render(camera, turn, 1);
  const cv::Rect half(camera.width_px / 2, 0, camera.width_px / 2, camera.height_px);
  first.image(half).copyTo(second.image(half));
  ImagePyramid before, newest;
  before.Build(first, geometry);
  newest.Build(second, geometry);
  CoverMask mask(geometry.camera[0]);
  const Matrix3d newest_from_before = turn.Inverse().RotationMatrix();
  const auto covered = [&](bool known) {
    mask.Reset();
    mask.Begin();
    if (known) AddPoints([](int, int, int) { return false; }, &mask);
    mask.AddStill(newest, before, newest_from_before, 1.0, 0.0);
    mask.Decide(kSecond);
    int left = 0, right = 0;
    for (float x = 12.0f; x < 192.0f; x += 24.0f) {
      for (float y = 12.0f; y < 144.0f; y += 24.0f) (x < 96.0f ? left : right) += mask.Covered(x, y);
    }
    return std::make_pair(left, right);
  };
  EXPECT_EQ(covered(false).first, 0);
  EXPECT_GE(covered(false).second, 20);  // of 24: some have too little texture
  EXPECT_EQ(covered(true).second, 0);    // points that are tracked there know better
}

// Points may fit by chance on a dull obstacle; its pattern is another one all the same.
TEST(CoverMask, APatternThatIsNotFoundOutweighsPointsThatFit) {
  CoverMask mask(Camera());
  mask.Begin();
  AddPoints([](int, int, int) { return false; }, &mask);
  CellMatches matches;
  for (std::size_t k = 0; k < matches.size(); ++k) matches[k] = {true, k % CoverMask::kColumns < 4 ? 0.2 : 0.95};
  matches[9] = {};  // among covered ones, and nothing is known of it
  mask.AddMatches(matches);
  mask.Decide(kSecond);
  EXPECT_TRUE(mask.Covered(60.0f, 30.0f));
  EXPECT_FALSE(mask.Covered(120.0f, 30.0f));
  EXPECT_FALSE(mask.Covered(36.0f, 36.0f)) << "its points say that it is free";
}

// What was seen behind the obstacle is seen again.
TEST(CoverMask, IsFreeWhereTheViewOfBeforeIsSeenAgain) {
  const Pinhole camera = testing::TestCamera();
  const PyramidGeometry geometry = PyramidGeometry::Make(camera, false, 6, 400);
  const testing::Scene scene;
  ImagePyramid pyramid;
  pyramid.Build(scene.Render(camera, testing::SwayPose(0), 0), geometry);
  std::vector<ReferencePoint> points;
  for (int y = 6; y < 138; y += 4) {
    for (int x = 6; x < 186; x += 4) {
      const double depth = scene.Depth(camera, testing::SwayPose(0), Vector2d(2.0 * x + 0.5, 2.0 * y + 0.5));
      points.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(1.0 / depth), 1.0f});
    }
  }
  TrackingReference reference;
  CoarseTracker(geometry, 9.0, 20.0).BuildReference(pyramid, points, &reference);
  CoverMask mask(geometry.camera[0]);
  mask.Begin();
  AddPoints([](int column, int, int) { return column < 4; }, &mask);
  mask.Decide(kSecond);
  ASSERT_TRUE(mask.Covered(60.0f, 30.0f));
  Frame frame = scene.Render(camera, testing::SwayPose(4), 4);
  frame.image(cv::Rect(0, 144, 384, 144)).setTo(70);  // the lower half is still behind something
  pyramid.Build(frame, geometry);
  mask.Begin();
  CellMatcher matcher;
  mask.AddMatches(matcher.Match(geometry, reference, pyramid, testing::SwayPose(4).Inverse() * testing::SwayPose(0),
                                CellGrid::kImage, 3));
  mask.Decide(kSecond + kSecond / 4);
  EXPECT_FALSE(mask.Covered(60.0f, 30.0f));
  EXPECT_TRUE(mask.Covered(60.0f, 110.0f));
}

}  // namespace
}  // namespace cairn::direct

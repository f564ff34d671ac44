#include "care/known_places.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "care/testing_two_visits.h"
#include "care/whole_map.h"
#include "store/testing_maps.h"

namespace cairn::care {
namespace {

class KnownPlacesTest : public ::testing::Test {
 protected:
  KnownPlacesTest() {
    EXPECT_TRUE(WriteNewMap(*visits_.map, NewMapInfo(visits_.map->info(), "visits"), "", path_, false, "made").ok());
    live_ = *engine::LiveMap::Open(path_);
  }
  const map::Snapshot& map() { return live_->Published()->map(); }
  // Of the component that is not aligned: keyframes 11 to 20.
  KnownPlaces Positions(const Sim3& world) {
    KnownPlaces known;
    map().keyframes().ForEach([&](const auto& keyframe) {
      if (keyframe->component == visits_.alone && known.positions.size() < 2) {
        known.positions.push_back({keyframe->id, world * keyframe->CenterInMap()});
      }
    });
    map().points().ForEach([&](const auto& point) {
      if (map().keyframe(point->reference.keyframe).component == visits_.alone && known.positions.size() < 6) {
        known.positions.push_back({point->id, world * point->position});
      }
    });
    return known;
  }

  const testing::TwoVisits visits_ = testing::MakeTwoVisits();
  const store::testing::TempFolder folder_;
  const std::string path_ = folder_.File("visits.cairn");
  std::unique_ptr<engine::LiveMap> live_;
};

TEST_F(KnownPlacesTest, PositionsGiveEverything) {
  const Sim3 world(ExpSO3(Vector3d(0.5, -0.3, 0.8)), Vector3d(10, 20, 1), 3.5);
  const auto aligned = AlignByKnownPlaces("visits", Positions(world), *live_);
  ASSERT_TRUE(aligned.ok()) << aligned.status();
  EXPECT_EQ(aligned->component, visits_.alone);
  EXPECT_LT(aligned->rmse_m, 1e-9);
  EXPECT_NEAR(map().WorldFrom(visits_.alone)->scale(), 3.5, 1e-9);
  EXPECT_LT((*map().WorldFrom(visits_.alone) * Vector3d(1, 2, 3) - world * Vector3d(1, 2, 3)).norm(), 1e-8);
  EXPECT_TRUE(absl::IsAlreadyExists(AlignByKnownPlaces("visits", Positions(world), *live_).status()));
}

TEST_F(KnownPlacesTest, WhatDoesNotFitIsRefused) {
  KnownPlaces known = Positions(Sim3());
  known.positions[0].world_m += Vector3d(50, 0, 0);
  const absl::Status status = AlignByKnownPlaces("visits", known, *live_).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
  EXPECT_FALSE(map().WorldFrom(visits_.alone));
  known.positions.resize(2);
  EXPECT_TRUE(absl::IsInvalidArgument(AlignByKnownPlaces("visits", known, *live_).status()));
  KnownPlaces of_two = Positions(Sim3());
  of_two.positions[1].of = KeyframeId(1);
  EXPECT_TRUE(absl::IsInvalidArgument(AlignByKnownPlaces("visits", of_two, *live_).status()));
  of_two.positions[1].of = PointId(100000);
  EXPECT_TRUE(absl::IsNotFound(AlignByKnownPlaces("visits", of_two, *live_).status()));
}

TEST_F(KnownPlacesTest, ADistanceGivesTheScaleAndGravityTheDirection) {
  KnownPlaces known;
  known.distances.push_back({KeyframeId(11), KeyframeId(16), 4.0});
  known.upright_cameras = true;
  const auto aligned = AlignByKnownPlaces("visits", known, *live_);
  ASSERT_TRUE(aligned.ok()) << aligned.status();
  const Sim3 world = *map().WorldFrom(visits_.alone);
  const double distance =
      (map().keyframe(KeyframeId(11)).CenterInMap() - map().keyframe(KeyframeId(16)).CenterInMap()).norm();
  EXPECT_NEAR(world.scale() * distance, 4.0, 1e-9);
  Vector3d up = Vector3d::Zero();
  for (KeyframeId id(11); id <= KeyframeId(20); id = KeyframeId(id.value() + 1)) {
    up -= world.TransformPose(map().keyframe(id).camera_from_map.Inverse()).RotationMatrix().col(1);
  }
  EXPECT_LT((up.normalized() - Vector3d::UnitZ()).norm(), 1e-9);
}

TEST_F(KnownPlacesTest, AnAlignedComponentIsScaledAndTurned) {
  const Sim3 before = *map().WorldFrom(visits_.shared);
  KnownPlaces known;
  known.distances.push_back({KeyframeId(1), KeyframeId(6), 1.0});
  known.overwrite = true;
  ASSERT_TRUE(AlignByKnownPlaces("visits", known, *live_).ok());
  const Sim3 after = *map().WorldFrom(visits_.shared);
  EXPECT_LT(AngleRad(after.rotation() * before.rotation().conjugate()), 1e-9) << "only the scale";
  KnownPlaces down;
  down.gravity = after.rotation() * Vector3d(0, 1, 0);  // along the first camera's y axis
  down.overwrite = true;
  ASSERT_TRUE(AlignByKnownPlaces("visits", down, *live_).ok());
  const Sim3 turned = *map().WorldFrom(visits_.shared);
  EXPECT_LT((turned.rotation() * Vector3d(0, 1, 0) + Vector3d::UnitZ()).norm(), 1e-9) << "down is -z";
  EXPECT_NEAR(turned.scale(), after.scale(), 1e-12);
  EXPECT_FALSE(KnownPlaces().Validate().ok());
}

TEST_F(KnownPlacesTest, PixelsNameThePointSeenThere) {
  const map::Keyframe& keyframe = map().keyframe(KeyframeId(12));
  const auto feature = static_cast<std::size_t>(
      std::ranges::find_if(keyframe.points, [](PointId id) { return id.valid(); }) - keyframe.points.begin());
  const image::Keypoint& at = keyframe.keypoints()[feature];
  KnownPlaces known;
  known.distances.push_back({SeenAt{keyframe.id, Vector2d(at.x_px + 0.2, at.y_px)}, keyframe.id, 2.0});
  const auto aligned = AlignByKnownPlaces("visits", known, *live_);
  ASSERT_TRUE(aligned.ok()) << aligned.status();
  known.overwrite = true;
  known.distances[0].from = SeenAt{keyframe.id, Vector2d(-500.0, -500.0)};
  EXPECT_TRUE(absl::IsNotFound(AlignByKnownPlaces("visits", known, *live_).status()));
}

TEST(Landmarks, AreReadAsTheyAreWritten) {
  std::vector<std::string> words = {"pixel", "3", "320.5", "240", "point", "12", "7"};
  const auto pixel = TakeLandmark(&words);
  ASSERT_TRUE(pixel.ok());
  EXPECT_EQ(std::get<SeenAt>(*pixel).keyframe, KeyframeId(3));
  EXPECT_EQ(std::get<PointId>(*TakeLandmark(&words)), PointId(12));
  EXPECT_THAT(words, ::testing::ElementsAre("7"));
  EXPECT_FALSE(TakeLandmark(&words).ok());
  for (std::vector<std::string> bad :
       {std::vector<std::string>{"point", "x"}, {"corner", "1"}, {"pixel", "1", "2"}, {"point", "0"}}) {
    EXPECT_FALSE(TakeLandmark(&bad).ok());
  }
}

}  // namespace
}  // namespace cairn::care

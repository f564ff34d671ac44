#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "engine/alignment_target.h"
#include "map/testing_two_visits.h"

namespace cairn::engine {
namespace {

using api::KnownPlaces;
using api::SeenAt;
using ::testing::HasSubstr;

class KnownPlacesTest : public ::testing::Test {
 protected:
  const map::Snapshot& map() { return *map_; }
  // What is found is in map() after it.
  absl::StatusOr<api::ComponentAlignment> Align(const KnownPlaces& known, bool overwrite = false, bool force = false) {
    api::AlignRequest request;
    request.by = known;
    request.overwrite = overwrite;
    request.force = force;
    map::Edit edit(map_);
    CAIRN_RETURN_IF_ERROR(request.Validate());
    CAIRN_ASSIGN_OR_RETURN(api::ComponentAlignment aligned, AlignByPlaces("visits", request, &edit));
    CAIRN_ASSIGN_OR_RETURN(map_, map_->Apply(edit.Finish("aligned")));
    return aligned;
  }
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

  const map::testing::TwoVisits visits_ = map::testing::MakeTwoVisits();
  std::shared_ptr<const map::Snapshot> map_ = visits_.map;
};

TEST_F(KnownPlacesTest, PositionsGiveEverything) {
  const Sim3 world(ExpSO3(Vector3d(0.5, -0.3, 0.8)), Vector3d(10, 20, 1), 3.5);
  const auto aligned = Align(Positions(world));
  ASSERT_TRUE(aligned.ok()) << aligned.status();
  EXPECT_EQ(aligned->component, visits_.alone);
  EXPECT_LT(aligned->rmse_all_m, 1e-9);
  EXPECT_NEAR(map().WorldFrom(visits_.alone)->scale(), 3.5, 1e-9);
  EXPECT_LT((*map().WorldFrom(visits_.alone) * Vector3d(1, 2, 3) - world * Vector3d(1, 2, 3)).norm(), 1e-8);
  EXPECT_TRUE(absl::IsAlreadyExists(Align(Positions(world)).status()));
}

TEST_F(KnownPlacesTest, WhatDoesNotFitIsRefused) {
  KnownPlaces known = Positions(Sim3());
  known.positions[0].world_m += Vector3d(50, 0, 0);
  const absl::Status status = Align(known).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
  EXPECT_FALSE(map().WorldFrom(visits_.alone));
  known.positions.resize(2);
  EXPECT_TRUE(absl::IsInvalidArgument(Align(known).status()));
  KnownPlaces of_two = Positions(Sim3());
  of_two.positions[1].of = KeyframeId(1);
  EXPECT_TRUE(absl::IsInvalidArgument(Align(of_two).status()));
  of_two.positions[1].of = PointId(100000);
  EXPECT_TRUE(absl::IsNotFound(Align(of_two).status()));
}

TEST_F(KnownPlacesTest, ADistanceGivesTheScaleAndGravityTheDirection) {
  KnownPlaces known;
  known.distances.push_back({KeyframeId(11), KeyframeId(16), 4.0});
  known.upright_cameras = true;
  const auto aligned = Align(known, false, true);
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
  EXPECT_THAT(Align(known, true).status().message(), HasSubstr("times")) << "it would change a lot";
  EXPECT_EQ(map().WorldFrom(visits_.shared)->scale(), before.scale());
  ASSERT_TRUE(Align(known, true, true).ok());
  const Sim3 after = *map().WorldFrom(visits_.shared);
  EXPECT_LT(AngleRad(after.rotation() * before.rotation().conjugate()), 1e-9) << "only the scale";
  KnownPlaces down;
  down.gravity = after.rotation() * Vector3d(0, 1, 0);  // along the first camera's y axis
  ASSERT_TRUE(Align(down, true).ok());
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
  EXPECT_THAT(Align(known).status().message(), HasSubstr("distances do not tell where"));
  const auto aligned = Align(known, false, true);
  ASSERT_TRUE(aligned.ok()) << aligned.status();
  known.distances[0].from = SeenAt{keyframe.id, Vector2d(-500.0, -500.0)};
  EXPECT_TRUE(absl::IsNotFound(Align(known, true).status()));
}

}  // namespace
}  // namespace cairn::engine

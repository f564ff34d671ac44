#include "inspect/difference.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "map/testing_map.h"

namespace cairn::inspect {
namespace {

using map::testing::MakeMap;
using map::testing::TestMap;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

std::shared_ptr<const map::Snapshot> After(const std::shared_ptr<const map::Snapshot>& map,
                                           const std::function<void(map::Edit*)>& change) {
  map::Edit edit(map);
  change(&edit);
  return *map->Apply(edit.Finish("change"));
}

TEST(Difference, OfAMapWithItselfIsNothing) {
  const TestMap world = MakeMap(3, 8, 300);
  const auto difference = Compare(*world.snapshot, *world.snapshot);
  ASSERT_TRUE(difference.ok()) << difference.status();
  EXPECT_TRUE(difference->same());
  EXPECT_EQ(difference->keyframes_kept, 8);
}

TEST(Difference, NamesWhatWasAddedRemovedAndMoved) {
  const TestMap world = MakeMap(3, 8, 300);
  const auto after = After(world.snapshot, [&](map::Edit* edit) {
    EXPECT_TRUE(edit->EraseKeyframe(KeyframeId(5)));
    edit->SetPose(KeyframeId(3),
                  SE3(Quaterniond::Identity(), Vector3d(0.5, 0, 0)) * edit->keyframe(KeyframeId(3)).camera_from_map);
    Random random(1);
    std::vector<std::size_t> visible;
    edit->AddKeyframe(map::testing::MakeKeyframe(world, 2, 0.0, random, &visible));
    edit->SetPosition(PointId(7), edit->point(PointId(7)).position + Vector3d(0, 0, 0.25));
    map::Session added = edit->session(SessionId(1));
    edit->AddSession(added);
  });
  const auto difference = Compare(*world.snapshot, *after);
  ASSERT_TRUE(difference.ok()) << difference.status();
  EXPECT_FALSE(difference->same());
  EXPECT_THAT(difference->keyframes_removed, ElementsAre(KeyframeId(5)));
  EXPECT_THAT(difference->keyframes_added, ElementsAre(KeyframeId(9)));
  EXPECT_THAT(difference->sessions_added, ElementsAre(SessionId(2)));
  EXPECT_EQ(difference->keyframes_kept, 7);
  // Six of seven have not moved: the fit is theirs.
  EXPECT_EQ(difference->keyframe_moves[0].id, KeyframeId(3));
  EXPECT_NEAR(difference->keyframe_moves[0].shift, 0.5, 1e-6);
  EXPECT_LT(difference->keyframe_moves[1].shift, 1e-6);
  EXPECT_EQ(difference->point_moves[0].id, PointId(7));
  EXPECT_NEAR(difference->point_moves[0].shift, 0.25, 1e-6);
  EXPECT_LT(difference->point_moves[1].shift, 1e-6);
}

TEST(Difference, AChangeOfFrameIsNoMove) {
  const TestMap world = MakeMap(3, 8, 300);
  const Sim3 other(ExpSO3(Vector3d(0.3, -0.2, 0.1)), Vector3d(1, 2, 3), 1.7);
  const auto moved = After(world.snapshot, [&](map::Edit* edit) {
    edit->base().keyframes().ForEach([&](const auto& keyframe) {
      edit->SetPose(keyframe->id, other.TransformPose(keyframe->camera_from_map.Inverse()).Inverse());
    });
    edit->base().points().ForEach([&](const auto& p) { edit->SetPosition(p->id, other * p->position); });
  });
  const auto fitted = Compare(*world.snapshot, *moved);
  ASSERT_TRUE(fitted.ok()) << fitted.status();
  ASSERT_EQ(fitted->fits.size(), 1u);
  EXPECT_NEAR(fitted->fits[0].first_from_second.scale(), 1.0 / 1.7, 1e-9);
  EXPECT_LT(fitted->keyframe_moves[0].shift, 1e-6);
  EXPECT_LT(fitted->point_moves[0].shift, 1e-6);
  const auto as_it_stands = Compare(*world.snapshot, *moved, {.align = false});
  EXPECT_GT(as_it_stands->keyframe_moves[0].shift, 1.0);
}

TEST(Difference, OfWhatIsNoEntityOfTheMap) {
  const TestMap world = MakeMap(3, 8, 300);
  const auto after = After(world.snapshot, [&](map::Edit* edit) {
    map::MapInfo info = edit->base().info();
    info.geo_anchor = map::GeoAnchor{.latitude_deg = 60.0, .longitude_deg = 25.0};
    edit->SetInfo(info);
  });
  const auto anchored = Compare(*world.snapshot, *after);
  ASSERT_TRUE(anchored.ok()) << anchored.status();
  EXPECT_TRUE(anchored->anchor_changed);
  EXPECT_FALSE(anchored->same());
  EXPECT_TRUE(Compare(*after, *after)->same());

  const auto corrected = After(world.snapshot, [&](map::Edit* edit) {
    map::MapCamera camera = edit->camera(CameraId(1));
    camera.lens = LensCorrection();
    edit->PutCamera(camera);
    camera.model.fx_px += 1.0;
    edit->AddCamera(camera);
  });
  const auto cameras = Compare(*world.snapshot, *corrected);
  ASSERT_TRUE(cameras.ok()) << cameras.status();
  EXPECT_THAT(cameras->cameras_changed, ElementsAre(CameraId(1)));
  EXPECT_THAT(cameras->cameras_added, ElementsAre(CameraId(2)));
  EXPECT_THAT(Compare(*corrected, *world.snapshot)->cameras_removed, ElementsAre(CameraId(2)));
}

// Two copies of a map went on by themselves: what each calls point 301 is another.
TEST(Difference, WhatWasAddedToEitherIsNotTheSame) {
  const TestMap world = MakeMap(3, 8, 300);
  const auto went_on = [&](std::int64_t time_ns, KeyframeId by) {
    return After(world.snapshot, [&](map::Edit* edit) {
      map::Keyframe keyframe = edit->keyframe(by);
      keyframe.time_ns = time_ns;
      const KeyframeId id = edit->AddKeyframe(keyframe);
      EXPECT_TRUE(edit->AddObservation(edit->AddPoint(Vector3d(0.1 * by.value(), 0, 3)), id, 0));
      edit->LinkIfAlone(id, by);
    });
  };
  const auto first = went_on(1, KeyframeId(2)), second = went_on(2, KeyframeId(6));
  const auto difference = Compare(*first, *second);
  ASSERT_TRUE(difference.ok()) << difference.status();
  EXPECT_THAT(difference->keyframes_added, ElementsAre(KeyframeId(9)));
  EXPECT_THAT(difference->keyframes_removed, ElementsAre(KeyframeId(9)));
  EXPECT_EQ(difference->points_added.size(), 1u);
  EXPECT_EQ(difference->points_removed, difference->points_added);
}

TEST(Difference, MapsThatHaveNothingInCommonAreNotCompared) {
  const TestMap one = MakeMap(3, 4, 200);
  const auto other = After(one.snapshot, [&](map::Edit* edit) {
    for (KeyframeId id(2); id <= KeyframeId(4); id = KeyframeId(id.value() + 1)) edit->EraseKeyframe(id);
  });
  const auto shifted = After(map::testing::MakeWorld(3, 4, 200).snapshot, [&](map::Edit* edit) {
    map::Keyframe keyframe = one.snapshot->keyframe(KeyframeId(1));
    keyframe.component = ComponentId();
    keyframe.time_ns += 5;
    edit->AddKeyframe(keyframe);
  });
  EXPECT_TRUE(absl::IsFailedPrecondition(Compare(*one.snapshot, *shifted).status()));
  // Ids and times of two runs coincide.
  map::Keyframe again = one.snapshot->keyframe(KeyframeId(1));
  const auto run_again = After(map::testing::MakeWorld(3, 4, 200).snapshot, [&](map::Edit* edit) {
    again.component = ComponentId();
    again.camera_from_direct = again.camera_from_direct * SE3(Quaterniond::Identity(), Vector3d(1e-9, 0, 0));
    edit->AddKeyframe(again);
  });
  ASSERT_EQ(run_again->keyframe(KeyframeId(1)).time_ns, one.snapshot->keyframe(KeyframeId(1)).time_ns);
  EXPECT_TRUE(absl::IsFailedPrecondition(Compare(*one.snapshot, *run_again).status()));
  EXPECT_TRUE(Compare(*one.snapshot, *other).ok());
}

// Merging gives new ids: that the two overlap is said, not that they could be merged.
TEST(Difference, WhatIsInCommonUnderOtherIdsIsToldToBe) {
  const TestMap one = MakeMap(3, 4, 200);
  const auto merged = After(map::testing::MakeWorld(3, 4, 200).snapshot, [&](map::Edit* edit) {
    map::Keyframe first = one.snapshot->keyframe(KeyframeId(1));
    map::Keyframe other = first;
    first.component = other.component = ComponentId();
    other.time_ns += 5;
    edit->AddKeyframe(other);
    edit->AddKeyframe(first);
  });
  const absl::Status status = Compare(*one.snapshot, *merged).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(status));
  EXPECT_THAT(status.message(), ::testing::HasSubstr("under other ids"));
}

}  // namespace
}  // namespace cairn::inspect

#include "mapping/lens_refinement.h"

#include <gtest/gtest.h>

#include "map/testing_map.h"
#include "mapping/local_adjustment.h"

namespace cairn::mapping {
namespace {

using map::testing::kPinhole;
using map::testing::MakeMap;
using map::testing::TestMap;

// The map as a session would have made it from images that this lens bent.
std::shared_ptr<const map::Snapshot> SeenThrough(const LensCorrection& lens, const TestMap& world) {
  const Camera camera = lens.CameraOf(kPinhole);
  map::Edit edit(world.snapshot);
  std::vector<KeyframeId> all;
  world.snapshot->keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
    std::vector<image::Keypoint> keypoints = keyframe->keypoints();
    for (image::Keypoint& keypoint : keypoints) {
      const auto seen = camera.Project(kPinhole.Unproject({keypoint.x_px, keypoint.y_px}));
      keypoint.x_px = static_cast<float>(seen->x());
      keypoint.y_px = static_cast<float>(seen->y());
    }
    edit.SetKeypoints(keyframe->id, keypoints);
    all.push_back(keyframe->id);
  });
  LocalAdjustmentOptions adjustment;
  adjustment.first_iterations = adjustment.second_iterations = 50;
  adjustment.function_tolerance = 1e-7;
  EXPECT_TRUE(AdjustKeyframes(edit, all, adjustment).ok());
  const auto after = world.snapshot->Apply(edit.Finish("seen through a lens"));
  return after.ok() ? *after : nullptr;
}

std::vector<KeyframeId> AllOf(const map::Snapshot& map) {
  std::vector<KeyframeId> all;
  map.keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) { all.push_back(keyframe->id); });
  return all;
}

TEST(LensRefinement, FindsALensAndCorrectsTheMap) {
  const TestMap world = MakeMap(5, 25, 1200, 0.3);
  const LensCorrection truth{0.995, 0.04, -0.03};
  const auto bent = SeenThrough(truth, world);
  map::Edit edit(bent);
  const auto report = RefineLens(edit, AllOf(*bent), world.camera, {});
  ASSERT_TRUE(report.ok()) << report.status();
  ASSERT_TRUE(report->has_value());
  EXPECT_TRUE((*report)->applied) << (*report)->reason;
  // These views hardly turn: they leave the focal length to the prior, and tell the distortion.
  EXPECT_NEAR((*report)->lens.k1, truth.k1, 0.02);
  EXPECT_NEAR((*report)->lens.k2, truth.k2, 0.02);
  EXPECT_GT((*report)->gain, 1000.0);
  const auto mended = bent->Apply(edit.Finish("lens"));
  ASSERT_TRUE(mended.ok()) << mended.status();
  EXPECT_EQ((*mended)->cameras().at(world.camera).lens, (*report)->lens);
  const auto turned_by = [&](const map::Snapshot& map, std::size_t i) {
    return AngleRad(
        (map.keyframe(KeyframeId(static_cast<std::uint32_t>(i + 1))).camera_from_map * world.poses[i].Inverse())
            .rotation());
  };
  double before = 0.0, after = 0.0;
  for (std::size_t i = 0; i < world.poses.size(); ++i) {
    before = std::max(before, turned_by(*bent, i));
    after = std::max(after, turned_by(**mended, i));
  }
  EXPECT_LT(after, 0.5 * before);
  // Asked again, it has nothing to say: the camera is corrected.
  map::Edit again(*mended);
  EXPECT_FALSE(RefineLens(again, AllOf(**mended), world.camera, {})->has_value());
}

TEST(LensRefinement, KeepsARightCalibration) {
  for (const std::uint64_t seed : {6, 7, 8}) {
    const TestMap world = MakeMap(seed, 12, 600, 0.5);
    const auto map = SeenThrough({}, world);
    map::Edit edit(map);
    const auto report = RefineLens(edit, AllOf(*map), world.camera, {});
    ASSERT_TRUE(report.ok() && report->has_value()) << report.status();
    EXPECT_FALSE((*report)->applied) << (*report)->reason;
    EXPECT_TRUE(edit.Finish("nothing").empty());
  }
}

TEST(LensRefinement, RefusesAnotherCamera) {
  const TestMap world = MakeMap(9, 25, 1200, 0.3);
  const auto bent = SeenThrough({0.9, 0.15, -0.1}, world);
  map::Edit edit(bent);
  const auto report = RefineLens(edit, AllOf(*bent), world.camera, {});
  ASSERT_TRUE(report.ok() && report->has_value()) << report.status();
  EXPECT_FALSE((*report)->applied);
  EXPECT_NE((*report)->reason.find("calibrate"), std::string::npos) << (*report)->reason;
  EXPECT_TRUE(edit.Finish("nothing").empty());
}

TEST(LensRefinement, IsNotAskedWhereItIsOff) {
  const TestMap world = MakeMap(10, 5, 100);
  map::Edit edit(world.snapshot);
  LensRefinementOptions off;
  off.enabled = false;
  EXPECT_FALSE(RefineLens(edit, AllOf(*world.snapshot), world.camera, off)->has_value());
  off.min_gain = 0.0;
  EXPECT_FALSE(off.Validate().ok());
}

}  // namespace
}  // namespace cairn::mapping

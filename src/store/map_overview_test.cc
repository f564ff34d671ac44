#include "store/map_overview.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <vector>

#include "store/sqlite.h"
#include "store/testing_files.h"
#include "store/testing_maps.h"

namespace cairn::store {
namespace {

using testing::MakeMap;
using testing::TempFolder;

std::int64_t BytesOf(const MapOverview& map, const std::string& name) {
  const auto part = std::ranges::find(map.parts, name, &MapPart::name);
  return part == map.parts.end() ? -1 : part->bytes;
}

class Overview : public ::testing::Test {
 protected:
  const TempFolder folder_;
  const std::string path_ = folder_.File("office.cairn");
};

TEST_F(Overview, SaysWhatTheLoadedMapSays) {
  const auto map = MakeMap(path_, 5, 40, {.features = 300, .new_points = 40});
  const auto overview = ReadMapOverview(path_);
  ASSERT_TRUE(overview.ok()) << overview.status();
  EXPECT_EQ(overview->summary.revision, map->revision());
  EXPECT_EQ(overview->summary.keyframes, 40);
  EXPECT_EQ(overview->summary.points, static_cast<std::int64_t>(map->points().size()));
  ASSERT_EQ(overview->sessions.size(), 1u);
  EXPECT_EQ(overview->sessions[0], map->sessions().begin()->second);
  ASSERT_EQ(overview->cameras.size(), 1u);
  EXPECT_EQ(overview->cameras[0], map->cameras().begin()->second);
  ASSERT_EQ(overview->shares.size(), 1u);
  EXPECT_EQ(overview->shares[0].keyframes, 40);
  EXPECT_EQ(overview->shares[0].component, ComponentId(1));

  double points = 0.0, covisible = 0.0, squares = 0.0, observed = 0.0, projected = 0.0;
  map->keyframes().ForEach([&](const auto& keyframe) {
    for (std::size_t i = 0; i < keyframe->points.size(); ++i) {
      if (!keyframe->points[i]) continue;
      points += 1.0 / 40.0;
      const Vector3d point_c = keyframe->camera_from_map * map->point(keyframe->points[i]).position;
      if (point_c.z() <= 0.0) continue;
      const auto& keypoint = keyframe->keypoints()[i];
      squares +=
          (map->pinhole(keyframe->camera).Project(point_c) - Vector2d(keypoint.x_px, keypoint.y_px)).squaredNorm();
      projected += 1.0;
    }
    for (const auto& edge : keyframe->covisible)
      covisible += edge.shared_points >= map::kMinCovisiblePoints ? 1.0 : 0.0;
  });
  map->points().ForEach([&](const auto& point) { observed += static_cast<double>(point->observations.size()); });
  const MapQuality& quality = overview->quality;
  EXPECT_TRUE(quality.all);
  EXPECT_EQ(quality.features, 300.0);
  EXPECT_NEAR(quality.points, points, 1e-9);
  EXPECT_NEAR(quality.covisible, covisible / 40.0, 1e-9);
  EXPECT_NEAR(quality.observations_per_point, observed / static_cast<double>(map->points().size()), 1e-9);
  const auto all = ReadMapOverview(path_, {.error_keyframes = 1000});
  ASSERT_TRUE(all.ok()) << all.status();
  EXPECT_EQ(all->quality.error_keyframes, 40);
  EXPECT_NEAR(all->quality.error_rms_px, std::sqrt(squares / projected), 1e-9 * std::sqrt(squares / projected));
}

TEST_F(Overview, PartsComeToTheFile) {
  MakeMap(path_, 6, 60, {.features = 500, .new_points = 60});
  const auto overview = ReadMapOverview(path_);
  ASSERT_TRUE(overview.ok()) << overview.status();
  std::int64_t sum = 0;
  for (const MapPart& part : overview->parts) {
    EXPECT_GE(part.bytes, 0) << part.name;
    sum += part.bytes;
  }
  EXPECT_EQ(sum, static_cast<std::int64_t>(std::filesystem::file_size(path_)));
  EXPECT_TRUE(std::ranges::is_sorted(overview->parts, std::ranges::greater(), &MapPart::bytes));
  EXPECT_EQ(BytesOf(*overview, "descriptors"), 60 * 500 * 32);
  EXPECT_EQ(BytesOf(*overview, "keypoints"), 60 * 500 * 9);
  EXPECT_EQ(BytesOf(*overview, "vocabulary"), 9000);
  // What is in no known part: pages that are not full.
  EXPECT_LT(BytesOf(*overview, "rest"), sum / 8);
}

// What SQLite itself counts, if it was built to count.
TEST_F(Overview, PointsTakeWhatSqliteSays) {
  MakeMap(path_, 7, 60, {.features = 300, .new_points = 60});
  const auto overview = ReadMapOverview(path_);
  ASSERT_TRUE(overview.ok()) << overview.status();
  auto database = *Database::OpenFile(path_, Database::Mode::kReadOnly);
  const auto counted = database->QueryInt("SELECT sum(payload + ncell * 5) FROM dbstat WHERE name = 'points'");
  if (!counted.ok()) GTEST_SKIP() << "this SQLite has no dbstat: " << counted.status();
  EXPECT_NEAR(static_cast<double>(BytesOf(*overview, "points")), static_cast<double>(*counted),
              0.04 * static_cast<double>(*counted));
}

TEST_F(Overview, ASampleIsNearTheWhole) {
  MakeMap(path_, 8, 90, {.features = 200, .new_points = 30});
  const auto all = ReadMapOverview(path_);
  const auto some = ReadMapOverview(path_, {.sampled_keyframes = 15, .error_keyframes = 5});
  ASSERT_TRUE(all.ok() && some.ok());
  EXPECT_FALSE(some->quality.all);
  EXPECT_EQ(some->quality.keyframes, 15);
  EXPECT_EQ(some->summary.keyframes, 90);
  EXPECT_EQ(some->shares[0].keyframes, 90);
  EXPECT_NEAR(some->quality.points, all->quality.points, 0.15 * all->quality.points);
  EXPECT_NEAR(static_cast<double>(BytesOf(*some, "descriptors")), static_cast<double>(BytesOf(*all, "descriptors")),
              1.0);
}

TEST_F(Overview, OfOlderFormatsToo) {
  for (const char* name : {"format1.cairn", "format2.cairn", "format3_parts.cairn"}) {
    const auto overview = ReadMapOverview(absl::StrCat(GOLDEN_FOLDER, "/", name));
    ASSERT_TRUE(overview.ok()) << overview.status();
    std::int64_t keyframes = 0;
    for (const KeyframeShare& share : overview->shares) {
      EXPECT_TRUE(share.component.valid());
      keyframes += share.keyframes;
    }
    EXPECT_EQ(keyframes, overview->summary.keyframes);
    EXPECT_FALSE(overview->components.empty());
  }
}

TEST_F(Overview, OfAnEmptyMapAndOfNone) {
  MakeMap(path_, 9, 0);
  const auto overview = ReadMapOverview(path_);
  ASSERT_TRUE(overview.ok()) << overview.status();
  EXPECT_EQ(overview->summary.keyframes, 0);
  EXPECT_EQ(overview->quality.features, 0.0);
  EXPECT_EQ(FaultOf(ReadMapOverview(folder_.File("none.cairn")).status()), Fault::kNotFound);
  std::ofstream(folder_.File("text.cairn")) << "this is not a map, but long enough to be looked at as if it were one";
  EXPECT_EQ(FaultOf(ReadMapOverview(folder_.File("text.cairn")).status()), Fault::kNotAMap);
}

}  // namespace
}  // namespace cairn::store

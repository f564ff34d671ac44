#include "store/map_assembly.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

namespace cairn::store {
namespace {

std::vector<std::shared_ptr<map::MapPoint>> PointsOf(const std::vector<std::uint32_t>& ids) {
  PointBlocks blocks;
  std::vector<std::shared_ptr<map::MapPoint>> points;
  for (const std::uint32_t id : ids) {
    points.push_back(blocks.Next());
    points.back()->id = PointId(id);
  }
  return points;
}

TEST(IdIndex, FindsEntitiesByDenseAndByScatteredIds) {
  for (const std::uint32_t step : {1u, 7u, 40000000u}) {
    std::vector<std::uint32_t> ids;
    for (std::uint32_t i = 0; i < 100; ++i) ids.push_back(5 + i * step);
    const auto points = PointsOf(ids);
    const IdIndex index(points);
    for (std::size_t i = 0; i < ids.size(); ++i) EXPECT_EQ(index.Find(ids[i]), i);
    for (const std::uint32_t id : {0u, 4u, ids.back() + 1, 0xffffffffu}) EXPECT_EQ(index.Find(id), IdIndex::kNone);
  }
  EXPECT_EQ(IdIndex(PointsOf({})).Find(1), IdIndex::kNone);
}

TEST(PointBlocks, APointOutlivesItsNeighbours) {
  std::vector<std::uint32_t> ids;
  for (std::uint32_t id = 1; id <= 100; ++id) ids.push_back(id);
  auto points = PointsOf(ids);
  for (const std::uint32_t id : ids) EXPECT_EQ(points[id - 1]->id, PointId(id));
  const std::shared_ptr<const map::MapPoint> one = points[40];
  points.clear();
  EXPECT_EQ(one->id, PointId(41));
}

}  // namespace
}  // namespace cairn::store

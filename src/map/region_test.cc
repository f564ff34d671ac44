#include "map/region.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "map/testing_map.h"

namespace cairn::map {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

class Region : public ::testing::Test {
 protected:
  // Cameras in a row, each of which shares most with its neighbours.
  const testing::TestMap world_ = testing::MakeMap(3, 12, 400);
  const Snapshot& map_ = *world_.snapshot;
};

TEST_F(Region, IsTheKeyframesAroundOthersOrAroundAPlace) {
  RegionQuery query;
  query.around = {KeyframeId(6)};
  query.max_keyframes = 1;
  EXPECT_THAT(KeyframesAround(map_, query), ElementsAre(KeyframeId(6)));
  query.max_keyframes = 3;
  const std::vector<KeyframeId> three = KeyframesAround(map_, query);
  const auto best = BestCovisible(map_.keyframe(KeyframeId(6)), 2);
  EXPECT_THAT(three, ::testing::UnorderedElementsAre(KeyframeId(6), best[0], best[1]));
  EXPECT_TRUE(std::ranges::is_sorted(three));
  query.max_keyframes = 1000;
  EXPECT_EQ(KeyframesAround(map_, query).size(), map_.keyframes().size());
  // One that is not there any more: the nearest to the place.
  query.around = {KeyframeId(999)};
  query.component = map_.keyframe(KeyframeId(9)).component;
  query.center = map_.keyframe(KeyframeId(9)).CenterInMap() + Vector3d(0.01, 0.0, 0.0);
  query.max_keyframes = 1;
  EXPECT_THAT(KeyframesAround(map_, query), ElementsAre(KeyframeId(9)));
  query.component = ComponentId(77);
  EXPECT_THAT(KeyframesAround(map_, query), IsEmpty());
}

TEST_F(Region, RowsAreThoseOfWhatComesGoesAndChanges) {
  const auto ids = [](std::initializer_list<std::uint32_t> values) {
    std::vector<KeyframeId> made;
    for (const std::uint32_t value : values) made.emplace_back(value);
    return made;
  };
  ChangedRows nothing;
  nothing.base = map_.revision();
  const ChangedRows still = RowsOfRegion(ids({2, 3, 4}), nothing, map_, ids({2, 3, 4}));
  EXPECT_TRUE(still.keyframes.empty() && still.points.empty());
  const ChangedRows moved = RowsOfRegion(ids({2, 3, 4}), nothing, map_, ids({3, 4, 5}));
  ASSERT_EQ(moved.keyframes.size(), 4u);
  EXPECT_EQ(moved.keyframes[0], (ChangedKeyframe{KeyframeId(2)})) << "goes";
  EXPECT_EQ(moved.keyframes[1], (ChangedKeyframe{KeyframeId(3)})) << "has other neighbours";
  EXPECT_EQ(moved.keyframes[3], (ChangedKeyframe{KeyframeId(5), true, true})) << "comes";
  EXPECT_FALSE(moved.points.empty());
  // What changes elsewhere is nobody's business here.
  ChangedRows elsewhere = nothing;
  elsewhere.keyframes = {{KeyframeId(11)}};
  EXPECT_TRUE(RowsOfRegion(ids({2, 3}), elsewhere, map_, ids({2, 3})).keyframes.empty());
  elsewhere.keyframes = {{KeyframeId(3), false, true}};
  EXPECT_EQ(RowsOfRegion(ids({2, 3}), elsewhere, map_, ids({2, 3})).keyframes, elsewhere.keyframes);
}

TEST_F(Region, AllOfAMapMakesItAnew) {
  const auto anew = Snapshot::Empty(map_.info(), map_.revision() - 1)->Apply(AllOf(map_));
  ASSERT_TRUE(anew.ok()) << anew.status();
  EXPECT_EQ((*anew)->revision(), map_.revision());
  const ChangedRows rows = RowsBetween(map_, **anew);
  EXPECT_TRUE(rows.keyframes.empty() && rows.points.empty() && rows.cameras.empty() && !rows.info);
}

}  // namespace
}  // namespace cairn::map

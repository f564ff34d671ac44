#include "map/draft.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "base/ids.h"

namespace cairn::map {
namespace {

using ::testing::ElementsAre;

using Strings = Table<PointId, std::string>;

Strings Numbers(std::uint32_t count) {
  Strings table;
  const TableEdit edit;
  for (std::uint32_t i = 1; i <= count; ++i) {
    table.Set(PointId(i), std::make_shared<const std::string>(std::to_string(i)), edit);
  }
  return table;
}

TEST(Draft, ReadsFallThroughAndWritesStay) {
  const Strings base = Numbers(200);
  Draft<PointId, std::string> draft(base, PointId(201));
  EXPECT_EQ(draft.Find(PointId(70)), base.Find(PointId(70)));
  draft.Mutable(PointId(70)) += "!";
  draft.Mutable(PointId(70)) += "!";
  EXPECT_EQ(*draft.Find(PointId(70)), "70!!");
  EXPECT_EQ(*base.Find(PointId(70)), "70");
  draft.Set(PointId(3), nullptr);
  EXPECT_EQ(draft.Find(PointId(3)), nullptr);
  EXPECT_EQ(draft.Find(PointId()), nullptr);
}

TEST(Draft, GrowsWithNewIds) {
  const Strings base = Numbers(5);
  Draft<PointId, std::string> draft(base, PointId(6));
  EXPECT_EQ(draft.Find(PointId(1000)), nullptr);
  draft.Set(PointId(1000), std::make_shared<std::string>("new"));
  EXPECT_EQ(*draft.Find(PointId(1000)), "new");
  EXPECT_EQ(draft.Find(PointId(999)), nullptr);
}

TEST(Draft, TouchedComeInOrder) {
  const Strings base = Numbers(200);
  Draft<PointId, std::string> draft(base, PointId(201));
  draft.Set(PointId(300), std::make_shared<std::string>("new"));
  draft.Mutable(PointId(199));
  draft.Set(PointId(64), nullptr);
  draft.Mutable(PointId(63));
  draft.Mark(PointId(10)) = 2;  // no change
  draft.Find(PointId(11));
  std::vector<std::string> touched;
  draft.ForEachTouched([&](PointId id, const std::shared_ptr<std::string>& value) {
    touched.push_back(std::to_string(id.value()) + (value ? *value : "-"));
  });
  EXPECT_THAT(touched, ElementsAre("6363", "64-", "199199", "300new"));
  EXPECT_EQ(draft.Mark(PointId(10)), 2);
}

}  // namespace
}  // namespace cairn::map

#include "map/linked_parts.h"

#include <gtest/gtest.h>

#include "map/testing_map.h"

namespace cairn::map {
namespace {

using testing::MakeMap;
using testing::TestMap;

// Keyframes 1 to 4 of a row of cameras, and two of another start that see the same points but have observed none.
class LinkedPartsTest : public ::testing::Test {
 protected:
  LinkedPartsTest() : world_(MakeMap(1, 4, 200)), edit_(world_.snapshot) {
    Random random(3);
    for (int i = 0; i < 2; ++i) {
      std::vector<std::size_t> visible;
      Keyframe keyframe = MakeKeyframe(world_, 3, 0.0, random, &visible);
      keyframe.direct_segment = 1;
      const KeyframeId id = edit_.AddKeyframe(keyframe);
      EXPECT_EQ(id, KeyframeId(static_cast<KeyframeId::Value>(5 + i)));
      edit_.LinkIfAlone(id, KeyframeId(id.value() - 1));
    }
  }

  using Partition = std::vector<std::vector<KeyframeId>>;

  Partition Parts() {
    const auto next = world_.snapshot->Apply(edit_.Finish("test"));
    EXPECT_TRUE(next.ok()) << next.status();
    return LinkedParts(**next).parts();
  }

  static std::vector<KeyframeId> Ids(int first, int last) {
    std::vector<KeyframeId> ids;
    for (int id = first; id <= last; ++id) ids.emplace_back(static_cast<KeyframeId::Value>(id));
    return ids;
  }

  TestMap world_;
  Edit edit_;
};

TEST_F(LinkedPartsTest, AnotherStartWithoutSharedPointsIsAPart) {
  EXPECT_EQ(Parts(), (Partition{Ids(1, 4), Ids(5, 6)})) << "the largest first; odometry links within a start";
}

TEST_F(LinkedPartsTest, SharedPointsLink) {
  int shared = 0;
  const Keyframe& fourth = world_.snapshot->keyframe(KeyframeId(4));
  for (std::uint32_t i = 0; i < fourth.points.size() && shared < kMinCovisiblePoints; ++i) {
    if (fourth.points[i]) shared += edit_.AddObservation(fourth.points[i], KeyframeId(6), i) ? 1 : 0;
  }
  ASSERT_EQ(shared, kMinCovisiblePoints);
  EXPECT_EQ(Parts(), (Partition{Ids(1, 6)}));
}

TEST_F(LinkedPartsTest, AFewSharedPointsDoNot) {
  const Keyframe& fourth = world_.snapshot->keyframe(KeyframeId(4));
  int shared = 0;
  for (std::uint32_t i = 0; i < fourth.points.size() && shared < kMinCovisiblePoints - 1; ++i) {
    if (fourth.points[i]) shared += edit_.AddObservation(fourth.points[i], KeyframeId(6), i) ? 1 : 0;
  }
  EXPECT_EQ(Parts().size(), 2u);
}

TEST_F(LinkedPartsTest, AClosedLoopLinks) {
  Session session = world_.snapshot->sessions().at(world_.session);
  ClosedLoop loop;
  loop.keyframe = KeyframeId(5), loop.loop_keyframe = KeyframeId(2);
  session.loops = {loop};
  edit_.PutSession(session);
  EXPECT_EQ(Parts(), (Partition{Ids(1, 6)}));
}

TEST_F(LinkedPartsTest, GivenPosesShareTheirFrame) {
  Random random(4);
  std::vector<std::size_t> visible;
  for (int i = 0; i < 2; ++i) {
    Keyframe keyframe = MakeKeyframe(world_, 0, 0.0, random, &visible);
    keyframe.direct_segment = -1;
    edit_.AddKeyframe(keyframe);
  }
  EXPECT_EQ(Parts(), (Partition{Ids(1, 4), Ids(5, 6), Ids(7, 8)}));
}

TEST(LinkedParts, OfAnEmptyMapAndOfAnUnknownKeyframe) {
  const LinkedParts none(*Snapshot::Empty(MapInfo{}));
  EXPECT_TRUE(none.parts().empty());
  EXPECT_EQ(none.PartOf(KeyframeId(1)), -1);
  const LinkedParts one(*MakeMap(2, 3, 100).snapshot);
  EXPECT_EQ(one.PartOf(KeyframeId(3)), 0);
  EXPECT_EQ(one.PartOf(KeyframeId(4)), -1);
}

}  // namespace
}  // namespace cairn::map

#include "map/component_assignment.h"

#include <gtest/gtest.h>

#include "map/testing_map.h"

namespace cairn::map {
namespace {

using testing::MakeMap;
using testing::TestMap;

using Parts = std::vector<std::vector<int>>;

// Keyframes as an old file holds them: 1 to 4 of a row of cameras, and two of another start that see the same points
// but have observed none, hung below them by a guess.
class ComponentAssignment : public ::testing::Test {
 protected:
  ComponentAssignment() : world_(MakeMap(1, 4, 200)) {
    world_.snapshot->keyframes().ForEach([&](const auto& keyframe) {
      keyframes_.push_back(std::make_shared<Keyframe>(*keyframe));
      keyframes_.back()->component = ComponentId();
    });
    sessions_ = {world_.snapshot->sessions().at(world_.session)};
    AddAlone(1);
    AddAlone(1);
    keyframes_[4]->parent = KeyframeId(4);
    keyframes_[3]->children.push_back(KeyframeId(5));
  }

  void AddAlone(std::int64_t segment) {
    auto keyframe = std::make_shared<Keyframe>(*keyframes_[3]);
    keyframe->id = KeyframeId(static_cast<KeyframeId::Value>(keyframes_.size() + 1));
    keyframe->direct_segment = segment;
    keyframe->points.assign(keyframe->points.size(), PointId());
    keyframe->parent = KeyframeId();
    keyframe->children.clear();
    keyframe->covisible.clear();
    keyframes_.push_back(std::move(keyframe));
  }

  Parts Assign(const std::optional<Sim3>& world = {}) {
    components_ = AssignComponents(world, keyframes_, &sessions_);
    Parts parts(components_.size());
    for (const auto& keyframe : keyframes_) {
      parts.at(keyframe->component.value() - 1).push_back(static_cast<int>(keyframe->id.value()));
    }
    return parts;
  }

  TestMap world_;
  std::vector<std::shared_ptr<Keyframe>> keyframes_;
  std::vector<Session> sessions_;
  std::vector<Component> components_;
};

TEST_F(ComponentAssignment, AnotherStartIsAComponentOfItsOwnAndItsGuessedLinkIsCut) {
  EXPECT_EQ(Assign(Sim3(Quaterniond::Identity(), Vector3d::Zero(), 2.0)), (Parts{{1, 2, 3, 4}, {5, 6}}));
  EXPECT_FALSE(keyframes_[4]->parent);
  EXPECT_TRUE(keyframes_[3]->children.empty() || keyframes_[3]->children.back() != KeyframeId(5));
  EXPECT_TRUE(components_[0].world_from_component.has_value()) << "the alignment was about the largest";
  EXPECT_FALSE(components_[1].world_from_component.has_value());
  EXPECT_EQ(sessions_[0].components, (std::vector<ComponentId>{ComponentId(1), ComponentId(2)}));
}

TEST_F(ComponentAssignment, OneSharedPointLinks) {
  const auto& points = keyframes_[3]->points;
  const auto seen = std::find_if(points.begin(), points.end(), [](PointId id) { return id.valid(); });
  keyframes_[5]->points[0] = *seen;
  EXPECT_EQ(Assign(), (Parts{{1, 2, 3, 4, 5, 6}})) << "5 and 6 are of one start";
}

TEST_F(ComponentAssignment, AClosedLoopLinks) {
  ClosedLoop loop;
  loop.keyframe = KeyframeId(5), loop.loop_keyframe = KeyframeId(2);
  sessions_[0].loops = {loop};
  EXPECT_EQ(Assign(), (Parts{{1, 2, 3, 4, 5, 6}}));
}

TEST_F(ComponentAssignment, GivenPosesShareTheirFrame) {
  AddAlone(-1);
  AddAlone(-1);
  EXPECT_EQ(Assign(), (Parts{{1, 2, 3, 4}, {5, 6}, {7, 8}}));
}

TEST_F(ComponentAssignment, AnEmptyMapHasOneToo) {
  keyframes_.clear();
  EXPECT_EQ(Assign(), (Parts{{}}));
}

}  // namespace
}  // namespace cairn::map

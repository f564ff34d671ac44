#include "engine/loop_runner.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "map/edit.h"
#include "mapping/testing_loop.h"

namespace cairn::engine {
namespace {

using mapping::FeatureMapper;
using mapping::testing::Ring;

// A feature module whose keyframes come from a ring of points instead of images, and the loop closing around it.
class RingMapper {
 public:
  explicit RingMapper(bool in_background, std::size_t points_per_part = mapping::AdjustmentMerge::kPointsPerPart) {
    mapper_ = *FeatureMapper::Create({}, &ring_.head(), SessionId(1), CameraId(1));
    ring_.head().mappers.push_back(mapper_.get());
    LoopRunnerOptions options;
    options.in_background = in_background;
    options.record_wall_clock = false;
    options.points_per_part = points_per_part;
    runner_ = *LoopRunner::Create(options);
  }

  void AddKeyframe() {
    mapping::KeyframeReport packet;
    packet.inserted = true;
    packet.keyframe = ring_.AddKeyframe();
    const absl::Status status = runner_->AfterPacket(packet, ring_.head());
    EXPECT_TRUE(status.ok()) << status;
  }

  absl::Status MergeAll() {
    runner_->WaitForAdjustment();
    for (;;) {
      const absl::StatusOr<bool> more = runner_->MergePart(ring_.head());
      if (!more.ok() || !*more) return more.status();
    }
  }

  // Once round; true if that closed a loop.
  bool GoRound(int max_keyframes = 110) {
    for (int i = 0; i < max_keyframes && runner_->loops().empty(); ++i) {
      error_before_ = ring_.Error();
      AddKeyframe();
    }
    return !runner_->loops().empty();
  }

  Ring ring_;
  std::unique_ptr<FeatureMapper> mapper_;
  std::unique_ptr<LoopRunner> runner_;
  double error_before_ = 0.0;
};

TEST(LoopRunner, AdjustsBesideTheMappingAndMergesWhatCameMeanwhile) {
  RingMapper run(/*in_background=*/true);
  ASSERT_TRUE(run.GoRound());
  const double closed = run.ring_.Error();
  EXPECT_LT(closed, run.error_before_ / 5.0);
  // The adjustment is under way, or done already: these arrive meanwhile, and must fit what it gives.
  const mapping::LoopReport& loop = run.runner_->loops().front();
  run.ring_.GoOn(loop.current, loop.correction.scales.at(loop.current));
  for (int i = 0; i < 3; ++i) run.AddKeyframe();
  ASSERT_TRUE(run.MergeAll().ok());
  EXPECT_EQ(std::count(run.ring_.head().reasons.begin(), run.ring_.head().reasons.end(), "full bundle adjustment"), 1);
  EXPECT_LT(run.ring_.Error(), closed);
  EXPECT_TRUE(run.ring_.map()->CheckConsistency().ok()) << run.ring_.map()->CheckConsistency();
  EXPECT_EQ(run.mapper_->map()->revision(), run.ring_.map()->revision());
  EXPECT_EQ(run.ring_.map()->sessions().at(SessionId(1)).loops.size(), 1u);
  EXPECT_GE(run.runner_->search_ms().count(), static_cast<std::int64_t>(run.ring_.map()->keyframes().size()));
}

// What others change between the parts stays, and the result is that of one change.
TEST(LoopRunner, MergesALargeAdjustmentInParts) {
  RingMapper at_once(/*in_background=*/true), in_parts(/*in_background=*/true, /*points_per_part=*/300);
  for (RingMapper* run : {&at_once, &in_parts}) {
    ASSERT_TRUE(run->GoRound());
    run->runner_->WaitForAdjustment();
  }
  ASSERT_TRUE(at_once.MergeAll().ok());
  const std::size_t closed = in_parts.ring_.head().reasons.size();
  int others = 0;
  for (bool more = true; more;) {
    const absl::StatusOr<bool> merged = in_parts.runner_->MergePart(in_parts.ring_.head());
    ASSERT_TRUE(merged.ok()) << merged.status();
    more = *merged;
    EXPECT_TRUE(in_parts.ring_.map()->CheckConsistency().ok()) << in_parts.ring_.map()->CheckConsistency();
    map::Edit other(in_parts.ring_.map());
    map::MapInfo info = other.info();
    info.name = absl::StrCat("name ", ++others);
    other.SetInfo(info);
    ASSERT_TRUE(in_parts.ring_.head().Commit(other.Finish("rename"), {}).ok());
  }
  EXPECT_GT(others, 5);
  EXPECT_EQ(in_parts.ring_.map()->info().name, absl::StrCat("name ", others));
  EXPECT_EQ(in_parts.ring_.head().reasons[closed], "full bundle adjustment, part 1");
  EXPECT_EQ(in_parts.ring_.head().reasons[closed + 2], "full bundle adjustment, part 2");

  const map::Snapshot& expected = *at_once.ring_.map();
  const map::Snapshot& parts = *in_parts.ring_.map();
  ASSERT_EQ(parts.keyframes().size(), expected.keyframes().size());
  ASSERT_EQ(parts.points().size(), expected.points().size());
  parts.keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
    EXPECT_EQ(keyframe->CenterInMap(), expected.keyframe(keyframe->id).CenterInMap());
  });
  parts.points().ForEach([&](const std::shared_ptr<const map::MapPoint>& point) {
    EXPECT_EQ(point->position, expected.point(point->id).position);
    EXPECT_EQ(point->observations, expected.point(point->id).observations);
  });
}

// A point that has been merged stays, also if its reference is then a keyframe whose turn comes later.
TEST(LoopRunner, APointIsMergedOnce) {
  RingMapper at_once(/*in_background=*/true), in_parts(/*in_background=*/true, /*points_per_part=*/300);
  for (RingMapper* run : {&at_once, &in_parts}) {
    ASSERT_TRUE(run->GoRound());
    run->runner_->WaitForAdjustment();
  }
  const map::Snapshot closed = *in_parts.ring_.map();
  ASSERT_TRUE(at_once.MergeAll().ok());
  ASSERT_TRUE(*in_parts.runner_->MergePart(in_parts.ring_.head()));
  const map::Snapshot& merged = *in_parts.ring_.map();
  const auto moved = [&](KeyframeId id) {
    return merged.keyframe(id).CenterInMap() != closed.keyframe(id).CenterInMap();
  };
  // Points that only keyframes of later parts are left to see.
  std::vector<PointId> handed_on;
  map::Edit edit(in_parts.ring_.map());
  merged.points().ForEach([&](const std::shared_ptr<const map::MapPoint>& point) {
    if (!moved(point->reference.keyframe)) return;
    std::vector<KeyframeId> gone;
    for (const map::Observation& seen : point->observations) {
      if (moved(seen.keyframe)) gone.push_back(seen.keyframe);
    }
    if (gone.size() + 2 > point->observations.size()) return;
    for (const KeyframeId id : gone) edit.RemoveObservation(point->id, id);
    handed_on.push_back(point->id);
  });
  ASSERT_GT(handed_on.size(), 10u);
  ASSERT_TRUE(in_parts.ring_.head().Commit(edit.Finish("seen from elsewhere"), {}).ok());
  ASSERT_TRUE(in_parts.MergeAll().ok());
  for (const PointId id : handed_on) {
    const map::MapPoint* point = in_parts.ring_.map()->points().Find(id);
    const map::MapPoint* expected = at_once.ring_.map()->points().Find(id);
    if (point == nullptr || expected == nullptr) continue;  // went with wrong observations
    EXPECT_EQ(point->position, expected->position);
  }
}

TEST(LoopRunner, WhatIsLeftOfAnAdjustmentGoesWhenTheMapIsCorrected) {
  RingMapper run(/*in_background=*/true, /*points_per_part=*/300);
  ASSERT_TRUE(run.GoRound());
  run.runner_->WaitForAdjustment();
  ASSERT_TRUE(*run.runner_->MergePart(run.ring_.head()));
  const Revision revision = run.ring_.map()->revision();
  run.runner_->OnCorrection();
  const absl::StatusOr<bool> more = run.runner_->MergePart(run.ring_.head());
  ASSERT_TRUE(more.ok()) << more.status();
  EXPECT_FALSE(*more);
  EXPECT_EQ(run.ring_.map()->revision(), revision);
}

TEST(LoopRunner, WithoutAThreadEverythingIsDoneAtOnce) {
  RingMapper first(/*in_background=*/false), second(/*in_background=*/false);
  ASSERT_TRUE(first.GoRound());
  EXPECT_EQ(first.ring_.head().reasons.back(), "full bundle adjustment");
  ASSERT_TRUE(second.GoRound());
  EXPECT_EQ(first.ring_.Error(), second.ring_.Error());
}

TEST(LoopRunner, IsCutShortWhenItIsNotWaitedFor) {
  RingMapper run(/*in_background=*/true);
  ASSERT_TRUE(run.GoRound());
  const auto map = run.ring_.map();
  run.runner_.reset();  // joins its thread
  EXPECT_EQ(run.ring_.map(), map);
}

TEST(LoopRunner, DoesNothingForWhatWasNotInserted) {
  RingMapper run(/*in_background=*/false);
  run.AddKeyframe();
  const Revision revision = run.ring_.map()->revision();
  EXPECT_TRUE(run.runner_->AfterPacket({}, run.ring_.head()).ok());
  EXPECT_TRUE(run.MergeAll().ok());
  EXPECT_EQ(run.ring_.map()->revision(), revision);
  LoopRunnerOptions bad;
  bad.loops.min_cells = 0;
  EXPECT_TRUE(absl::IsInvalidArgument(LoopRunner::Create(bad).status()));
}

}  // namespace
}  // namespace cairn::engine

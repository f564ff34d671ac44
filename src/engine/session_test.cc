#include "engine/session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <thread>

#include "engine/testing_sway.h"
#include "store/testing_maps.h"

namespace cairn::engine {
namespace {

using store::testing::TempFolder;
using ::testing::HasSubstr;

std::unique_ptr<LiveMap> MakeMap(const std::string& path) {
  map::MapInfo info = store::testing::TestInfo();
  info.vocabulary_hash = 0;
  auto live = LiveMap::Create(path, info, nullptr);
  EXPECT_TRUE(live.ok()) << live.status();
  return *std::move(live);
}

SessionOptions Threads(int threads) {
  SessionOptions options;
  options.deterministic = threads == 0;
  options.threads = std::max(threads, 1);
  return options;
}

absl::StatusOr<SessionReport> RunAll(const SessionOptions& options, const std::vector<RawFrame>& frames,
                                     LiveMap* live) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session, Session::Create(options, testing::SwaySource(), live));
  for (const RawFrame& frame : frames) CAIRN_RETURN_IF_ERROR(session->AddFrame(frame).status());
  return session->Finish();
}

TEST(Session, DeterministicRunsAreEqualToTheBit) {
  const TempFolder folder;
  SessionReport reports[2];
  std::shared_ptr<const map::Snapshot> maps[2];
  for (int run = 0; run < 2; ++run) {
    const auto live = MakeMap(folder.File(std::to_string(run)));
    const auto report = RunAll(Threads(0), testing::Sway(40), live.get());
    ASSERT_TRUE(report.ok()) << report.status();
    reports[run] = *report;
    maps[run] = live->Published()->snapshot();
  }
  EXPECT_GE(reports[0].keyframes, 2);
  EXPECT_TRUE(store::testing::SameBits(*maps[0], *maps[1]));
  ASSERT_EQ(reports[0].frame_poses.size(), 40u);
  ASSERT_EQ(reports[1].frame_poses.size(), 40u);
  for (std::size_t i = 0; i < 40; ++i) {
    const std::optional<SE3>&a = reports[0].frame_poses[i].map_from_camera,
          &b = reports[1].frame_poses[i].map_from_camera;
    ASSERT_TRUE(a && b) << "frame " << i;
    EXPECT_EQ(a->Matrix(), b->Matrix());
  }
}

TEST(Session, ThreadedRunsTrackEveryFrameAndMakeTheMap) {
  const TempFolder folder;
  for (const int threads : {2, 3}) {
    const auto live = MakeMap(folder.File(std::to_string(threads)));
    const auto report = RunAll(Threads(threads), testing::Sway(40), live.get());
    ASSERT_TRUE(report.ok()) << report.status();
    EXPECT_EQ(report->frames_tracked, 40);
    EXPECT_GE(report->keyframes, 2);
    EXPECT_EQ(report->frame_ms.count(), 40);
    EXPECT_TRUE(live->Published()->map().CheckConsistency().ok());
    ASSERT_TRUE(live->Close().ok());
    const auto file = LiveMap::Open(live->uri());
    ASSERT_TRUE(file.ok()) << file.status();
    EXPECT_EQ(static_cast<std::int64_t>((*file)->Published()->map().keyframes().size()), report->keyframes);
  }
}

TEST(Session, AMapThatCannotBeWrittenEndsTheSessionWithThatError) {
  for (const int threads : {0, 3}) {
    std::unique_ptr<LiveMap> live;
    {
      const TempFolder folder;
      live = MakeMap(folder.File("gone.cairn"));
    }  // and with it the folder of the map
    const absl::Status status = RunAll(Threads(threads), testing::Sway(40), live.get()).status();
    ASSERT_FALSE(status.ok()) << threads;
    EXPECT_THAT(std::string(status.message()), HasSubstr("gone.cairn")) << threads;
  }
}

TEST(Session, WithoutAMapFinishSaysWhy) {
  const TempFolder folder;
  for (const int threads : {0, 3}) {
    const auto live = MakeMap(folder.File("none.cairn"));
    const auto report = RunAll(Threads(threads), testing::Still(6), live.get());
    EXPECT_EQ(report.status().code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(report.status().message()), HasSubstr("the camera has not moved enough"));
    EXPECT_FALSE(std::filesystem::exists(live->uri()));
  }
}

// The odometry's word from before it started is not why the feature module did not.
TEST(Session, WithoutAMapTheStageThatDidNotStartIsNamedAndTheOdometrysPosesAreKnown) {
  const TempFolder folder;
  for (const int threads : {0, 3}) {
    const auto live = MakeMap(folder.File("none.cairn"));
    SessionOptions options = Threads(threads);
    options.mapping.min_start_points = 100000;
    auto session = Session::Create(options, testing::SwaySource(), live.get());
    ASSERT_TRUE(session.ok()) << session.status();
    for (const RawFrame& frame : testing::Sway(40)) ASSERT_TRUE((*session)->AddFrame(frame).ok());
    const absl::Status status = (*session)->Finish().status();
    EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(status.message()), HasSubstr("the odometry tracked 40 of 40 frames"));
    EXPECT_THAT(std::string(status.message()), HasSubstr("the feature module could not start"));
    EXPECT_THAT(std::string(status.message()), HasSubstr("a start needs 100000 features with depth"));
    EXPECT_THAT(std::string(status.message()), Not(HasSubstr("moved enough")));
    const auto odometry = (*session)->FinalOdometry();
    ASSERT_TRUE(odometry.ok()) << odometry.status();
    EXPECT_EQ(odometry->frames_tracked, 40);
  }
}

TEST(Session, MayBeAbandonedAtAnyTime) {
  const TempFolder folder;
  for (const int threads : {2, 3}) {
    const auto live = MakeMap(folder.File(std::to_string(threads)));
    auto session = Session::Create(Threads(threads), testing::SwaySource(), live.get());
    ASSERT_TRUE(session.ok()) << session.status();
    for (const RawFrame& frame : testing::Sway(30)) ASSERT_TRUE((*session)->AddFrame(frame).ok());
  }
}

TEST(Session, LivePosesMayBeAskedForByAnotherThreadAtAnyTime) {
  const TempFolder folder;
  for (const int threads : {0, 3}) {
    const auto live = MakeMap(folder.File(std::to_string(threads)));
    auto session = Session::Create(Threads(threads), testing::SwaySource(), live.get());
    ASSERT_TRUE(session.ok()) << session.status();
    std::atomic<bool> ended = false;
    int answers = 0;
    std::size_t frames = 0;
    bool shrunk = false, finite = true;
    std::thread asker([&] {
      while (!ended) {
        const std::vector<FramePose> poses = (*session)->FramePoses();
        shrunk |= poses.size() < frames;
        frames = poses.size();
        for (const FramePose& frame : poses) {
          finite &= !frame.map_from_camera || frame.map_from_camera->Matrix().allFinite();
        }
        ++answers;
      }
    });
    for (const RawFrame& frame : testing::Sway(40)) EXPECT_TRUE((*session)->AddFrame(frame).ok());
    const auto report = (*session)->Finish();
    ended = true;
    asker.join();
    ASSERT_TRUE(report.ok()) << report.status();
    EXPECT_GT(answers, 0);
    EXPECT_FALSE(shrunk);
    EXPECT_TRUE(finite);
    const std::vector<FramePose> last = (*session)->FramePoses();
    ASSERT_EQ(last.size(), report->frame_poses.size());
    for (std::size_t i = 0; i < last.size(); ++i) {
      ASSERT_EQ(last[i].map_from_camera.has_value(), report->frame_poses[i].map_from_camera.has_value()) << i;
      if (!last[i].map_from_camera) continue;
      EXPECT_EQ(last[i].map_from_camera->Matrix(), report->frame_poses[i].map_from_camera->Matrix()) << i;
    }
  }
}

// Changes of the map, a loop's correction among them, are made by whoever has its head. It is taken away here until
// every frame has been tracked: tracking, the odometry's mapping and live poses need none of it.
TEST(Session, NobodyWaitsForAChangeOfTheMapInTheMaking) {
  const TempFolder folder;
  const auto live = MakeMap(folder.File("held.cairn"));
  auto session = Session::Create(Threads(3), testing::SwaySource(), live.get());
  ASSERT_TRUE(session.ok()) << session.status();
  {
    const LiveMap::Editor editor = live->BeginEdit();
    for (const RawFrame& frame : testing::Sway(40)) {
      const auto result = (*session)->AddFrame(frame);
      ASSERT_TRUE(result.ok());
      (*session)->PoseInMap(*result);
      (*session)->FramePoses();
    }
    EXPECT_EQ((*session)->KeyframesInMap(), 0);
  }
  const auto report = (*session)->Finish();
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->frames_tracked, 40);
  EXPECT_GE(report->keyframes, 2);
}

// Two cameras at once, and somebody who edits beside them: nobody fails for a change of another.
TEST(Session, SeveralExtendOneMapAtTheSameTime) {
  const TempFolder folder;
  const auto live = MakeMap(folder.File("shared.cairn"));
  const std::shared_ptr<Subscription> changes = live->Subscribe();
  std::atomic<bool> done = false;
  std::atomic<int> edits = 0;
  std::thread administrator([&] {
    while (!done) {
      const auto revision = live->Edit([&](const map::Snapshot& head) -> absl::StatusOr<std::optional<map::Delta>> {
        if (head.components().empty()) return std::nullopt;
        map::Delta delta;
        delta.base = head.revision();
        map::Component component = head.components().begin()->second;
        component.world_from_component = Sim3(Quaterniond::Identity(), Vector3d(edits, 0, 0), 1.0);
        delta.components = {component};
        return delta;
      });
      EXPECT_TRUE(revision.ok()) << revision.status();
      ++edits;
      std::this_thread::yield();
    }
  });
  std::vector<absl::StatusOr<SessionReport>> reports(2, absl::UnknownError("did not run"));
  std::vector<std::thread> sessions;
  for (auto& report : reports) {
    sessions.emplace_back([&] { report = RunAll(Threads(2), testing::Sway(40), live.get()); });
  }
  for (std::thread& thread : sessions) thread.join();
  done = true;
  administrator.join();
  for (const auto& report : reports) {
    ASSERT_TRUE(report.ok()) << report.status();
    EXPECT_EQ(report->frames_tracked, 40);
  }
  EXPECT_NE(reports[0]->component, reports[1]->component) << "without a vocabulary neither can find the other";
  EXPECT_GT(edits, 1);
  const auto map = live->Published()->snapshot();
  EXPECT_TRUE(map->CheckConsistency().ok()) << map->CheckConsistency();
  EXPECT_EQ(map->cameras().size(), 1u) << "the same camera is one";
  EXPECT_EQ(map->sessions().size(), 2u);
  ASSERT_TRUE(live->Close().ok());
  // Every revision was told, once and in order.
  std::shared_ptr<const map::Snapshot> followed = changes->first()->snapshot();
  for (;;) {
    const auto change = changes->Next(std::chrono::seconds(10));
    if (!change.ok()) break;
    ASSERT_TRUE(change->has_value());
    const auto next = followed->Apply(*(*change)->delta);
    ASSERT_TRUE(next.ok()) << next.status();
    followed = *next;
  }
  EXPECT_TRUE(store::testing::SameBits(*followed, *map));
}

TEST(Session, BadOptionsAreRefused) {
  SessionOptions options;
  EXPECT_TRUE(options.Validate().ok()) << options.Validate();
  options.threads = 0;
  EXPECT_FALSE(options.Validate().ok());
  options = {};
  options.mapping_backlog = 0;
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace cairn::engine

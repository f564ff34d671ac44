#include "engine/session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <future>
#include <thread>

#include "engine/testing_sway.h"
#include "store/test_maps.h"

namespace cairn::engine {
namespace {

using store::testing::TempFolder;
using ::testing::HasSubstr;

std::unique_ptr<MapWriter> MakeWriter(const std::string& path) {
  map::MapInfo info = store::testing::TestInfo();
  info.vocabulary_hash = 0;
  auto writer = MapWriter::Create(path, info, {});
  EXPECT_TRUE(writer.ok()) << writer.status();
  return *std::move(writer);
}

SessionOptions Threads(int threads) {
  SessionOptions options;
  options.deterministic = threads == 0;
  options.threads = std::max(threads, 1);
  return options;
}

absl::StatusOr<SessionReport> RunAll(const SessionOptions& options, const std::vector<RawFrame>& frames,
                                     MapWriter* writer) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session,
                         Session::Create(options, testing::SwaySource(), nullptr, writer));
  for (const RawFrame& frame : frames) CAIRN_RETURN_IF_ERROR(session->AddFrame(frame).status());
  return session->Finish();
}

TEST(Session, DeterministicRunsAreEqualToTheBit) {
  const TempFolder folder;
  SessionReport reports[2];
  std::shared_ptr<const map::Snapshot> maps[2];
  for (int run = 0; run < 2; ++run) {
    const auto writer = MakeWriter(folder.File(std::to_string(run)));
    const auto report = RunAll(Threads(0), testing::Sway(40), writer.get());
    ASSERT_TRUE(report.ok()) << report.status();
    reports[run] = *report;
    maps[run] = writer->Current();
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
    const auto writer = MakeWriter(folder.File(std::to_string(threads)));
    const auto report = RunAll(Threads(threads), testing::Sway(40), writer.get());
    ASSERT_TRUE(report.ok()) << report.status();
    EXPECT_EQ(report->frames_tracked, 40);
    EXPECT_GE(report->keyframes, 2);
    EXPECT_EQ(report->frame_ms.count(), 40);
    EXPECT_TRUE(writer->Current()->CheckConsistency().ok());
    ASSERT_TRUE(writer->Close().ok());
    const auto file = MapWriter::Open(writer->path());
    ASSERT_TRUE(file.ok()) << file.status();
    EXPECT_EQ(static_cast<std::int64_t>((*file)->Current()->keyframes().size()), report->keyframes);
  }
}

TEST(Session, AMapThatCannotBeWrittenEndsTheSessionWithThatError) {
  for (const int threads : {0, 3}) {
    std::unique_ptr<MapWriter> writer;
    {
      const TempFolder folder;
      writer = MakeWriter(folder.File("gone.cairn"));
    }  // and with it the folder of the map
    const absl::Status status = RunAll(Threads(threads), testing::Sway(40), writer.get()).status();
    ASSERT_FALSE(status.ok()) << threads;
    EXPECT_THAT(std::string(status.message()), HasSubstr("gone.cairn")) << threads;
  }
}

TEST(Session, WithoutAMapFinishSaysWhy) {
  const TempFolder folder;
  for (const int threads : {0, 3}) {
    const auto writer = MakeWriter(folder.File("none.cairn"));
    const auto report = RunAll(Threads(threads), testing::Still(6), writer.get());
    EXPECT_EQ(report.status().code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(report.status().message()), HasSubstr("the camera has not moved enough"));
    EXPECT_FALSE(std::filesystem::exists(writer->path()));
  }
}

TEST(Session, MayBeAbandonedAtAnyTime) {
  const TempFolder folder;
  for (const int threads : {2, 3}) {
    const auto writer = MakeWriter(folder.File(std::to_string(threads)));
    auto session = Session::Create(Threads(threads), testing::SwaySource(), nullptr, writer.get());
    ASSERT_TRUE(session.ok()) << session.status();
    for (const RawFrame& frame : testing::Sway(30)) ASSERT_TRUE((*session)->AddFrame(frame).ok());
  }
}

TEST(Session, LivePosesMayBeAskedForByAnotherThreadAtAnyTime) {
  const TempFolder folder;
  for (const int threads : {0, 3}) {
    const auto writer = MakeWriter(folder.File(std::to_string(threads)));
    auto session = Session::Create(Threads(threads), testing::SwaySource(), nullptr, writer.get());
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

// Changes of the map, a loop's correction among them, are made by the feature module's thread through one function. It
// is held up here in the middle of the first one until every frame has been tracked: whatever it holds, tracking, the
// odometry's mapping and live poses need none of it.
TEST(Session, NobodyWaitsForAChangeOfTheMapInTheMaking) {
  const TempFolder folder;
  const auto writer = MakeWriter(folder.File("held.cairn"));
  std::promise<void> tracked;
  const std::shared_future<void> all_tracked = tracked.get_future().share();
  std::atomic<int> held = 0, in_vain = 0;
  SessionOptions options = Threads(3);
  options.on_change = [&](const map::Delta&) {
    ++held;
    if (all_tracked.wait_for(std::chrono::seconds(60)) != std::future_status::ready) ++in_vain;
  };
  auto session = Session::Create(options, testing::SwaySource(), nullptr, writer.get());
  ASSERT_TRUE(session.ok()) << session.status();
  for (const RawFrame& frame : testing::Sway(40)) {
    const auto result = (*session)->AddFrame(frame);
    ASSERT_TRUE(result.ok());
    (*session)->PoseInMap(*result);
    (*session)->FramePoses();
  }
  EXPECT_EQ(in_vain, 0);
  tracked.set_value();
  const auto report = (*session)->Finish();
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_GE(held, 2);
  EXPECT_EQ(in_vain, 0);
  EXPECT_EQ(report->frames_tracked, 40);
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

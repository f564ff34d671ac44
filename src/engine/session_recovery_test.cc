// A session whose odometry is lost goes on where the map says it is.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <thread>

#include "engine/session.h"
#include "engine/testing_sway.h"
#include "image/orb_extractor.h"
#include "place/training.h"
#include "store/testing_maps.h"

namespace cairn::engine {
namespace {

using store::testing::TempFolder;

constexpr int kWay = 110;   // frames along a wall; the odometry forgets where it began
constexpr int kBlack = 4;   // then nothing is seen
constexpr int kThere = 24;  // and the camera is back near the beginning, going to and fro

// Along the back wall, `x_m` to the right; the sway makes parallax in every direction.
SE3 At(double x_m, double sway) {
  return {ExpSO3(Vector3d(0.02 * std::sin(0.7 * sway), 0.03 * std::sin(0.4 * sway), 0.0)),
          Vector3d(x_m, 0.08 * std::sin(sway), 0.1 * std::sin(0.6 * sway))};
}

SE3 PoseAt(int i) {
  const int since = i - kWay - kBlack;
  return i < kWay ? At(0.06 * i, 0.1 * i) : At(0.5 + 0.03 * since, 2.0 + 0.1 * since);
}

const std::vector<RawFrame>& Recording() {
  static const std::vector<RawFrame> frames = [] {
    const direct::testing::Scene scene;
    std::vector<RawFrame> all;
    for (int i = 0; i < kWay + kBlack + kThere; ++i) {
      const direct::Frame frame = scene.Render(direct::testing::TestCamera(), PoseAt(i), i);
      all.push_back({frame.index, frame.time_ns, frame.image, 0.0});
      if (i >= kWay && i < kWay + kBlack) all.back().gray.setTo(0);
    }
    return all;
  }();
  return frames;
}

// Frame `i` of an endless recording.
RawFrame FrameAt(int i) {
  const int turn = (i - kWay - kBlack) % (2 * kThere);
  const int at = i < kWay + kBlack ? i : kWay + kBlack + (turn < kThere ? turn : 2 * kThere - 1 - turn);
  RawFrame frame = Recording()[static_cast<std::size_t>(at)];
  frame.index = i;
  frame.time_ns = i * TimeNs{33'333'333};
  return frame;
}

const place::Vocabulary& Words() {
  static const place::Vocabulary vocabulary = [] {
    std::vector<place::ImageDescriptors> images;
    for (int i = 0; i < kWay; i += 6) {
      images.push_back(image::OrbExtractor(image::OrbParameters{}).Extract(FrameAt(i).gray, 500)->descriptors);
    }
    return *place::Train(images, {.branching = 8, .depth = 3, .max_iterations = 4});
  }();
  return vocabulary;
}

struct Outcome {
  int frames_until_found = -1;  // after the black ones
  absl::StatusOr<SessionReport> report;
};

// With threads a lost camera is shown no faster than `kPace`: an answer of the map is about one of the frames that the
// odometry still keeps, and from a camera they do not come by the thousand a second either.
constexpr std::chrono::milliseconds kPace(5);

Outcome Play(const SessionOptions& options, int max_frames, const std::string& path) {
  map::MapInfo info = store::testing::TestInfo();
  info.vocabulary_hash = Words().hash();
  const auto live = *LiveMap::Create(path, info, std::make_shared<const place::Vocabulary>(Words()));
  const auto session = *Session::Create(options, testing::SwaySource(), live.get());
  Outcome outcome;
  const int back = kWay + kBlack;
  for (int i = 0; i < max_frames; ++i) {
    const auto result = session->AddFrame(FrameAt(i));
    EXPECT_TRUE(result.ok()) << result.status();
    if (i < back || !result.ok()) continue;
    if (outcome.frames_until_found < 0 && session->PoseInMap(*result)) outcome.frames_until_found = i - back;
    if (outcome.frames_until_found >= 0 && i > back + outcome.frames_until_found + 12) break;
    if (outcome.frames_until_found < 0 && !options.deterministic) std::this_thread::sleep_for(kPace);
  }
  outcome.report = session->Finish();
  return outcome;
}

// Root mean square distance of the frames' positions from the truth, with the scale, and place, of those on the way.
double ErrorAfter(const SessionReport& report) {
  const auto& frames = report.frame_poses;
  const SE3 map_from_world = *frames[10].map_from_camera * PoseAt(10).Inverse();
  const double scale = (frames[90].map_from_camera->translation() - frames[10].map_from_camera->translation()).norm() /
                       (PoseAt(90).translation() - PoseAt(10).translation()).norm();
  double sum = 0.0;
  int count = 0;
  for (std::size_t i = kWay + kBlack; i < frames.size(); ++i) {
    if (!frames[i].map_from_camera) continue;
    const int turn = (static_cast<int>(i) - kWay - kBlack) % (2 * kThere);
    const SE3 truth = PoseAt(kWay + kBlack + (turn < kThere ? turn : 2 * kThere - 1 - turn));
    const Vector3d way = truth.translation() - PoseAt(10).translation();
    const Vector3d expected = frames[10].map_from_camera->translation() + scale * (map_from_world.rotation() * way);
    sum += (frames[i].map_from_camera->translation() - expected).squaredNorm() / (scale * scale);
    ++count;
  }
  return std::sqrt(sum / std::max(1, count));
}

SessionOptions Options(int threads) {
  SessionOptions options;
  options.deterministic = threads == 0;
  options.threads = std::max(threads, 1);
  options.odometry.max_lost_frames = 100000;  // no start without the map
  options.memory.min_share = 0.0;             // the refined trajectory
  return options;
}

TEST(SessionRecovery, ALostOdometryIsFoundInTheMapWithinAFewFrames) {
  const TempFolder folder;
  const Outcome outcome = Play(Options(0), kWay + kBlack + kThere, folder.File("found.cairn"));
  ASSERT_TRUE(outcome.report.ok()) << outcome.report.status();
  EXPECT_GE(outcome.frames_until_found, 0);
  EXPECT_LE(outcome.frames_until_found, 3);
  EXPECT_EQ(outcome.report->odometry.recoveries, 1);
  EXPECT_EQ(outcome.report->odometry.segments, 2);
  for (const FramePose& frame : outcome.report->frame_poses) {
    const bool black = frame.index >= kWay && frame.index < kWay + kBlack;
    EXPECT_EQ(frame.map_from_camera.has_value(), !black) << frame.index;
  }
  EXPECT_LT(ErrorAfter(*outcome.report), 0.03) << "metres";
}

TEST(SessionRecovery, NobodyAsksTheMapWhereThatIsSwitchedOff) {
  const TempFolder folder;
  SessionOptions options = Options(0);
  options.seek_after_frames = 0;
  const Outcome outcome = Play(options, kWay + kBlack + kThere, folder.File("not.cairn"));
  ASSERT_TRUE(outcome.report.ok()) << outcome.report.status();
  EXPECT_TRUE(outcome.frames_until_found < 0 || outcome.frames_until_found > 10) << outcome.frames_until_found;
  EXPECT_EQ(outcome.report->odometry.recoveries, 0);
}

TEST(SessionRecovery, ThreadsFindItAsWell) {
  const TempFolder folder;
  for (const int threads : {2, 3}) {
    const Outcome outcome = Play(Options(threads), kWay + kBlack + 3000, folder.File(std::to_string(threads)));
    ASSERT_TRUE(outcome.report.ok()) << outcome.report.status();
    EXPECT_GE(outcome.frames_until_found, 0) << threads;
    EXPECT_GE(outcome.report->odometry.recoveries, 1) << threads << ", found after " << outcome.frames_until_found;
    // The map of threads is another one in each run; what is found in the wrong place is decimetres off.
    EXPECT_LT(ErrorAfter(*outcome.report), 0.06)
        << "metres, " << threads << ", found after " << outcome.frames_until_found;
  }
}

// In one thread an answer is about the map that is there: what an adjustment moves has moved in the next answer.
TEST(SessionLivePoses, FollowEveryChangeOfTheMap) {
  const TempFolder folder;
  map::MapInfo info = store::testing::TestInfo();
  info.vocabulary_hash = 0;
  const auto live_map = *LiveMap::Create(folder.File("live.cairn"), info, nullptr);
  auto session = Session::Create(Options(0), testing::SwaySource(), live_map.get());
  ASSERT_TRUE(session.ok()) << session.status();
  std::vector<FramePose> before;
  int compared = 0, moved = 0, live = 0;
  for (int i = 0; i < kWay; ++i) {
    const RawFrame frame = FrameAt(i);
    const auto result = (*session)->AddFrame(frame);
    ASSERT_TRUE(result.ok());
    const std::vector<FramePose> now = (*session)->FramePoses();
    ASSERT_EQ(now.size(), static_cast<std::size_t>(frame.index + 1));
    live_map->Published()->map().keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
      const auto at = static_cast<std::size_t>(keyframe->frame_index);
      ASSERT_TRUE(now[at].map_from_camera) << at;
      EXPECT_LT((*now[at].map_from_camera * keyframe->camera_from_map).Log().norm(), 1e-9) << at;
      ++compared;
      if (at >= before.size() || !before[at].map_from_camera) return;
      moved += (before[at].map_from_camera->Inverse() * *now[at].map_from_camera).Log().norm() > 1e-7 ? 1 : 0;
    });
    if (const std::optional<LivePose> pose = (*session)->PoseInMap(*result)) {
      ++live;
      EXPECT_LT((now.back().map_from_camera->Inverse() * pose->map_from_camera).Log().norm(), 1e-3) << frame.index;
    }
    before = now;
  }
  EXPECT_GT(compared, 10);
  EXPECT_GT(moved, 3) << "nothing was adjusted: this test shows nothing";
  EXPECT_GT(live, 10);
  const auto report = (*session)->Finish();
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->frames_tracked, kWay);
}

}  // namespace
}  // namespace cairn::engine

#include "mapping/feature_mapper.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "geometry/alignment.h"
#include "image/orb_extractor.h"
#include "mapping/component_join.h"
#include "mapping/testing_head.h"
#include "mapping/testing_room.h"
#include "place/training.h"

namespace cairn::mapping {
namespace {

using testing::CirclePose;
using testing::kRoomPinhole;
using testing::PacketMaker;
using testing::Room;

FeatureMapperOptions SmallOptions() {
  FeatureMapperOptions options;
  options.min_features = 500;
  options.max_features = 700;
  return options;
}

// A mapper over a map that lives in the test.
struct TestRun {
  std::shared_ptr<testing::TestHead> head;  // perhaps shared with the run before
  SessionId session;
  CameraId camera;
  std::unique_ptr<FeatureMapper> mapper;
  std::vector<KeyframeReport> reports;
  std::vector<SE3> truth;

  explicit TestRun(std::shared_ptr<testing::TestHead> start = nullptr) : head(std::move(start)) {
    if (head == nullptr) head = MakeHead(nullptr);
    map::Edit edit(map());
    camera = edit.AddCamera({CameraId(), "camera", Camera::FromPinhole(kRoomPinhole), kRoomPinhole});
    map::Session added;
    added.camera = camera;
    session = edit.AddSession(added);
    EXPECT_TRUE(head->Commit(edit.Finish("session"), {}).ok());
    auto made = FeatureMapper::Create(SmallOptions(), head.get(), session, camera);
    EXPECT_TRUE(made.ok()) << made.status();
    if (!made.ok()) return;
    mapper = std::move(*made);
    head->mappers.push_back(mapper.get());
  }
  ~TestRun() { std::erase(head->mappers, mapper.get()); }

  static std::shared_ptr<testing::TestHead> MakeHead(const place::Vocabulary* vocabulary) {
    map::MapInfo info;
    info.id = std::string(32, '1');
    if (vocabulary != nullptr) info.vocabulary_hash = vocabulary->hash();
    return std::make_shared<testing::TestHead>(map::Snapshot::Empty(info), vocabulary);
  }

  const std::shared_ptr<const map::Snapshot>& map() const { return head->map(); }

  void Process(const direct::KeyframePacket& packet, const SE3& room_from_camera) {
    const auto report = mapper->Process(packet);
    ASSERT_TRUE(report.ok()) << report.status();
    reports.push_back(*report);
    truth.push_back(room_from_camera);
  }

  // Root mean square of the camera centres after Sim(3) alignment; every keyframe must be located.
  double Error() const {
    std::vector<Vector3d> estimated, expected;
    for (const TrajectoryKeyframe& keyframe : mapper->Trajectory(*map())) {
      EXPECT_TRUE(keyframe.located) << keyframe.direct_keyframe;
      estimated.push_back(keyframe.map_from_camera.translation());
      expected.push_back(truth[static_cast<std::size_t>(keyframe.direct_keyframe)].translation());
    }
    const auto alignment = AlignPoints(expected, estimated);
    EXPECT_TRUE(alignment.ok()) << alignment.status();
    return alignment.ok() ? alignment->rmse : 1e9;
  }

  int Count(FeatureState state) const {
    int count = 0;
    for (const KeyframeReport& report : reports) count += report.state == state ? 1 : 0;
    return count;
  }
};

// Once round the room and a little further, while the direct module's unit doubles: the map must hold its scale, and
// the last keyframes must find the points of the first.
TEST(FeatureMapper, HoldsTheScaleAndFindsOldPointsAgain) {
  const Room room;
  PacketMaker packets(room);
  TestRun run;
  constexpr int kPackets = 48;
  for (int i = 0; i < kPackets; ++i) {
    const SE3 pose = CirclePose(i / 44.0, 0.9);
    run.Process(packets.Make(pose, std::pow(2.0, static_cast<double>(i) / kPackets)), pose);
    if (HasFatalFailure()) return;
  }
  EXPECT_EQ(run.Count(FeatureState::kLost), 0);
  EXPECT_LT(run.Error(), 0.02) << "metres, on a circle of radius 0.9";
  EXPECT_NEAR(run.reports.back().map_per_direct / run.reports[4].map_per_direct, std::pow(2.0, 43.0 / kPackets), 0.15);
  EXPECT_TRUE(run.map()->CheckConsistency().ok()) << run.map()->CheckConsistency();
  EXPECT_GT(run.map()->points().size(), 1000u);
  EXPECT_LT(run.map()->keyframes().size(), static_cast<std::size_t>(kPackets)) << "not everything is inserted";

  KeyframeId last;
  run.map()->keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) { last = keyframe->id; });
  bool joined = false;
  for (const map::CovisibilityEdge& edge : run.map()->keyframe(last).covisible) joined |= edge.keyframe.value() <= 4;
  EXPECT_TRUE(joined) << "the circle is not joined";

  const double before = run.Error();
  ASSERT_TRUE(run.mapper->Finish().ok());
  EXPECT_LT(run.Error(), before + 0.002);
  EXPECT_TRUE(run.map()->CheckConsistency().ok()) << run.map()->CheckConsistency();
}

// Five seconds of blank walls at two keyframes a second: the direct module carries on, the feature module says that it
// is lost, starts anew from direct depths when texture returns, and the new part hangs on the old one.
TEST(FeatureMapper, CarriesOnThroughFiveSecondsWithoutTexture) {
  Room room;
  room.blank_from_rad = 0.5;
  room.blank_to_rad = 2.9;
  PacketMaker packets(room);
  packets.period_ns = 500000000;
  TestRun run;
  for (int i = 0; i < 44; ++i) {
    const SE3 pose = CirclePose(i / 60.0, 0.9);
    run.Process(packets.Make(pose, 1.0), pose);
    if (HasFatalFailure()) return;
  }
  std::int64_t lost_since_ns = -1, longest_ns = 0;
  int restarts = 0, relocations = 0;
  for (const KeyframeReport& report : run.reports) {
    restarts += report.restarted ? 1 : 0;
    relocations += report.relocated ? 1 : 0;
    if (report.state != FeatureState::kLost) {
      lost_since_ns = -1;
      continue;
    }
    if (lost_since_ns < 0) lost_since_ns = report.time_ns;
    longest_ns = std::max(longest_ns, report.time_ns - lost_since_ns);
    EXPECT_FALSE(report.message.empty());
  }
  EXPECT_GE(longest_ns, 5'000'000'000) << "the stretch is too short to show anything";
  EXPECT_EQ(restarts, 1);
  EXPECT_EQ(relocations, 0) << "nothing of the old map is in sight after the stretch";
  EXPECT_EQ(run.reports.back().state, FeatureState::kGood);
  // The part without a map rests on the odometry and on the relative scale known before it.
  EXPECT_LT(run.Error(), 0.12) << "metres on a way of 4.1, the lost keyframes among them";
  int roots = 0;
  run.map()->keyframes().ForEach([&](const auto& keyframe) { roots += keyframe->parent ? 0 : 1; });
  EXPECT_EQ(roots, 1) << "the new start is linked to the old map";
  EXPECT_TRUE(run.map()->CheckConsistency().ok()) << run.map()->CheckConsistency();
}

// The room's own vocabulary, and packets of a first visit: a quarter round it.
struct FirstVisit {
  Room room;
  PacketMaker packets{room};
  std::vector<direct::KeyframePacket> made;
  std::shared_ptr<const place::Vocabulary> vocabulary;

  FirstVisit() {
    std::vector<place::ImageDescriptors> images;
    for (int i = 0; i < 12; ++i) {
      made.push_back(packets.Make(CirclePose(i / 44.0, 0.9), 1.0));
      images.push_back(image::OrbExtractor(image::OrbParameters{}).Extract(made.back().frame.image, 400)->descriptors);
    }
    auto trained = place::Train(images, {.branching = 8, .depth = 3, .max_iterations = 4});
    EXPECT_TRUE(trained.ok()) << trained.status();
    vocabulary = std::make_shared<const place::Vocabulary>(*std::move(trained));
  }

  void Map(TestRun* run) const {
    for (int i = 0; i < 12; ++i) {
      run->Process(made[static_cast<std::size_t>(i)], CirclePose(i / 44.0, 0.9));
      if (HasFatalFailure()) return;
    }
  }
  static bool HasFatalFailure() { return ::testing::Test::HasFatalFailure(); }
};

// Another session, elsewhere at first and in units of its own, maps into a component of its own, and is joined to what
// it turns out to overlap.
TEST(FeatureMapper, ASecondSessionIsJoinedWhereItOverlaps) {
  const FirstVisit visit;
  TestRun old(TestRun::MakeHead(visit.vocabulary.get()));
  visit.Map(&old);
  if (HasFatalFailure()) return;
  EXPECT_FALSE(old.map()->keyframe(KeyframeId(1)).features->words.empty());
  ASSERT_EQ(old.map()->LiveComponents().size(), 1u);
  const std::size_t keyframes_before = old.map()->keyframes().size();

  TestRun extended(old.head);
  PacketMaker other(visit.room, 7);
  auto joiner = ComponentJoiner::Create();
  ASSERT_TRUE(joiner.ok());
  std::optional<JoinReport> joined;
  for (int i = 0; i < 18; ++i) {
    const SE3 pose = CirclePose((i - 7) / 44.0, 0.85);
    extended.Process(other.Make(pose, 0.5), pose);
    if (HasFatalFailure()) return;
    if (!extended.reports.back().inserted) continue;
    const auto report = joiner->Process(extended.reports.back().keyframe, 0, *old.head);
    ASSERT_TRUE(report.ok()) << report.status();
    if (report->joined) joined = *report;
    EXPECT_TRUE(old.map()->CheckConsistency().ok()) << old.map()->CheckConsistency();
  }
  EXPECT_TRUE(extended.reports[0].located) << "in its own component";
  EXPECT_EQ(extended.reports[0].component, ComponentId(2));
  ASSERT_TRUE(joined.has_value());
  EXPECT_EQ(joined->component, ComponentId(2));
  EXPECT_EQ(joined->into, ComponentId(1));
  EXPECT_NEAR(joined->scale, 0.5, 0.02) << "metres per unit of the second session";
  EXPECT_EQ(extended.mapper->component(), ComponentId(1));
  EXPECT_EQ(extended.reports.back().component, ComponentId(1));
  EXPECT_EQ(extended.reports.back().state, FeatureState::kGood);
  EXPECT_EQ(extended.map()->LiveComponents(), std::vector<ComponentId>{ComponentId(1)});
  EXPECT_GT(extended.map()->keyframes().size(), keyframes_before);
  EXPECT_LT(extended.Error(), 0.02) << "all keyframes, those before the join as well";
  int shared = 0;
  for (const auto& edge : extended.map()->keyframe(joined->current).covisible) {
    shared += extended.map()->keyframe(edge.keyframe).session == old.session ? 1 : 0;
  }
  EXPECT_GT(shared, 0) << "points of both sessions have become one";
}

TEST(FeatureMapper, AnAlignedSideDoesNotMove) {
  const FirstVisit visit;
  TestRun old(TestRun::MakeHead(visit.vocabulary.get()));
  visit.Map(&old);
  if (HasFatalFailure()) return;
  ASSERT_TRUE(old.mapper->Finish().ok());
  map::Edit align(old.map());
  map::Component component = old.map()->component(ComponentId(1));
  component.world_from_component = Sim3();
  align.PutComponent(component);
  ASSERT_TRUE(old.head->Commit(align.Finish("align"), {}).ok());
  const auto before = old.map();

  TestRun extended(old.head);
  PacketMaker other(visit.room, 8);
  auto joiner = ComponentJoiner::Create();
  for (int i = 0; i < 18; ++i) {
    const SE3 pose = CirclePose((i - 2) / 44.0, 0.8);
    extended.Process(other.Make(pose, 2.0), pose);
    if (HasFatalFailure()) return;
    if (!extended.reports.back().inserted) continue;
    ASSERT_TRUE(joiner->Process(extended.reports.back().keyframe, 0, *old.head).ok());
  }
  ASSERT_TRUE(extended.mapper->Finish().ok());
  ASSERT_EQ(extended.mapper->component(), ComponentId(1));
  before->keyframes().ForEach([&](const auto& keyframe) {
    const map::Keyframe* now = extended.map()->keyframes().Find(keyframe->id);
    ASSERT_NE(now, nullptr);
    EXPECT_EQ(now->camera_from_map.Matrix(), keyframe->camera_from_map.Matrix());
  });
  EXPECT_LT(extended.Error(), 0.02);
}

// Both components are aligned, and where they overlap they are not in the same place of the world: one of them is
// wrong.
TEST(FeatureMapper, AlignmentsThatContradictEachOtherAreNotJoined) {
  const FirstVisit visit;
  TestRun old(TestRun::MakeHead(visit.vocabulary.get()));
  visit.Map(&old);
  if (HasFatalFailure()) return;
  ASSERT_TRUE(old.mapper->Finish().ok());
  const auto align = [&](ComponentId id, const Vector3d& shift) {
    map::Edit edit(old.head->View()->snapshot());
    map::Component component = edit.component(id);
    component.world_from_component = Sim3(SE3(Quaterniond::Identity(), shift));
    edit.PutComponent(component);
    ASSERT_TRUE(old.head->Commit(edit.Finish("align"), {}).ok());
  };
  align(ComponentId(1), Vector3d::Zero());

  TestRun extended(old.head);
  PacketMaker other(visit.room, 8);
  auto joiner = ComponentJoiner::Create();
  int contradicted = 0;
  for (int i = 0; i < 18; ++i) {
    const SE3 pose = CirclePose((i - 2) / 44.0, 0.8);
    extended.Process(other.Make(pose, 1.0), pose);
    if (i == 0) align(ComponentId(2), Vector3d(1.5, 0.0, 0.0));
    if (HasFatalFailure()) return;
    if (!extended.reports.back().inserted) continue;
    const auto report = joiner->Process(extended.reports.back().keyframe, 0, *old.head);
    ASSERT_TRUE(report.ok()) << report.status();
    EXPECT_FALSE(report->joined);
    contradicted += report->rejected.starts_with("both are aligned to the world") ? 1 : 0;
  }
  EXPECT_GT(contradicted, 0);
  EXPECT_EQ(extended.map()->LiveComponents(), (std::vector<ComponentId>{ComponentId(1), ComponentId(2)}));
}

// Two rooms that have nothing in common.
TEST(FeatureMapper, ASessionElsewhereStaysAComponentOfItsOwn) {
  const FirstVisit visit;
  TestRun old(TestRun::MakeHead(visit.vocabulary.get()));
  visit.Map(&old);
  if (HasFatalFailure()) return;
  Room elsewhere;
  elsewhere.half = {2.3, 1.9, 3.4};
  elsewhere.salt = 77;
  TestRun extended(old.head);
  PacketMaker other(elsewhere, 9);
  auto joiner = ComponentJoiner::Create();
  for (int i = 0; i < 14; ++i) {
    const SE3 pose = CirclePose(i / 44.0, 0.85);
    extended.Process(other.Make(pose, 1.0), pose);
    if (HasFatalFailure()) return;
    if (!extended.reports.back().inserted) continue;
    const auto report = joiner->Process(extended.reports.back().keyframe, 0, *old.head);
    ASSERT_TRUE(report.ok()) << report.status();
    EXPECT_FALSE(report->joined);
  }
  EXPECT_EQ(extended.map()->LiveComponents(), (std::vector<ComponentId>{ComponentId(1), ComponentId(2)}));
  EXPECT_LT(extended.Error(), 0.02);
}

// After a loss the odometry begins anew in units of its own, in a place that is known: until depths have told the scale
// there, nothing is put into the map by it.
TEST(FeatureMapper, AScaleThatIsNotKnownIsNotUsed) {
  const FirstVisit visit;
  TestRun run(TestRun::MakeHead(visit.vocabulary.get()));
  visit.Map(&run);
  if (HasFatalFailure()) return;
  PacketMaker anew(visit.room, 5);
  for (int i = 0; i < 14; ++i) {
    const SE3 pose = CirclePose((12 - i) / 44.0, 0.9);
    direct::KeyframePacket packet = anew.Make(pose, 3.0, /*segment=*/1);
    packet.keyframe += 12;
    packet.frame.index += 60;
    packet.frame.time_ns += 12 * anew.period_ns;
    if (i < 3) packet.points.clear();  // no depths: the scale cannot be told
    run.Process(packet, pose);
    if (HasFatalFailure()) return;
    EXPECT_FALSE(i < 3 && run.reports.back().inserted);
  }
  EXPECT_TRUE(run.reports[12].relocated || run.reports[13].relocated || run.reports[14].relocated);
  EXPECT_NEAR(run.reports.back().map_per_direct / run.reports[11].map_per_direct, 3.0, 0.1);
  EXPECT_LT(run.Error(), 0.02);
}

TEST(FeatureMapper, SaysWhatItWaitsForAndRefusesBadInput) {
  Room blank;
  blank.blank_from_rad = -4.0;
  blank.blank_to_rad = 4.0;
  PacketMaker packets(blank);
  TestRun run;
  run.Process(packets.Make(CirclePose(0.0, 0.9), 1.0), CirclePose(0.0, 0.9));
  EXPECT_EQ(run.reports[0].state, FeatureState::kInitializing);
  EXPECT_NE(run.reports[0].message.find("100 features"), std::string::npos) << run.reports[0].message;
  EXPECT_EQ(run.head->reasons.size(), 1u) << "the session alone";

  const auto code = [&](const direct::KeyframePacket& packet) { return run.mapper->Process(packet).status().code(); };
  direct::KeyframePacket packet = packets.Make(CirclePose(0.01, 0.9), 1.0);
  direct::KeyframePacket bad = packet;
  bad.keyframe = 0;
  EXPECT_EQ(code(bad), absl::StatusCode::kInvalidArgument) << "older than the last";
  bad = packet;
  bad.frame.image = cv::Mat(10, 10, CV_8UC1);
  EXPECT_EQ(code(bad), absl::StatusCode::kInvalidArgument);
  bad = packet;
  bad.direct_from_camera.translation().x() = std::nan("");
  EXPECT_EQ(code(bad), absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(run.mapper->Process(packet).ok()) << "nothing of the bad ones was kept";

  FeatureMapperOptions options;
  options.tracker.min_inliers = 1;
  EXPECT_EQ(FeatureMapper::Create(options, run.head.get(), run.session, run.camera).status().code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(FeatureMapper::Create({}, run.head.get(), SessionId(9), run.camera).status().code(),
            absl::StatusCode::kInvalidArgument);
  auto failing = FeatureMapper::Create(SmallOptions(), run.head.get(), run.session, run.camera);
  ASSERT_TRUE(failing.ok());
  run.head->fail_with = absl::ResourceExhaustedError("the disk is full");
  const Room room;
  PacketMaker textured(room);
  EXPECT_EQ((*failing)->Process(textured.Make(CirclePose(0.0, 0.9), 1.0)).status().code(),
            absl::StatusCode::kResourceExhausted);
}

}  // namespace
}  // namespace cairn::mapping

// The test suite of api::MapService: every implementation passes the same one. Include it in one file of a test binary
// that links cairn::localizer_conformance, and instantiate it with a factory:
//
//   INSTANTIATE_TEST_SUITE_P(Hosted, MapServiceConformance, testing::Values(MapServiceFactory(&OpenHost)));
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "api/map_service.h"
#include "client/conformance/conformance_map.h"
#include "map/edit.h"
#include "store/digest.h"
#include "store/fault.h"
#include "store/map_store.h"

namespace cairn::conformance {

// Makes a service of the maps in `directory`. It may keep what it needs (a server, say) alive in the service.
using MapServiceFactory = std::function<absl::StatusOr<std::unique_ptr<api::MapService>>(const std::string& directory)>;

class MapServiceConformance : public testing::TestWithParam<MapServiceFactory> {
 protected:
  void SetUp() override {
    directory_ = testing::TempDir() + "/map_service_conformance_" + std::to_string(getpid());
    std::filesystem::remove_all(directory_);
    std::filesystem::create_directory(directory_);
    ASSERT_TRUE(WriteConformanceMap(directory_ + "/room.cairn").ok());
    std::ofstream(directory_ + "/broken.cairn") << "this is no map, but long enough to be one perhaps";
    std::ofstream(directory_ + "/notes.txt") << "not listed";
    auto service = GetParam()(directory_);
    ASSERT_TRUE(service.ok()) << service.status();
    service_ = *std::move(service);
  }
  void TearDown() override {
    service_.reset();
    std::filesystem::remove_all(directory_);
  }

  static api::LocalizeQuery Query() {
    const ConformanceMap& map = TheConformanceMap();
    return {map.room.Render(map.pinhole, LookInRoom({0.2, 0.0, -1.4}, 0.05)), Camera::FromPinhole(map.pinhole), 42};
  }

  std::string directory_;
  std::unique_ptr<api::MapService> service_;
};

TEST_P(MapServiceConformance, ListsAllMapsByNameAndSaysWhatCannotBeRead) {
  const map::Snapshot& map = *TheConformanceMap().snapshot;
  const auto maps = service_->List();
  ASSERT_TRUE(maps.ok()) << maps.status();
  ASSERT_EQ(maps->size(), 2u);
  const api::MapSummary& broken = (*maps)[0];
  EXPECT_EQ(broken.name, "broken");
  EXPECT_FALSE(broken.status.ok());
  EXPECT_THAT(std::string(broken.status.message()), testing::Not(testing::HasSubstr(directory_)));
  const api::MapSummary& room = (*maps)[1];
  EXPECT_EQ(room.name, "room");
  EXPECT_TRUE(room.status.ok()) << room.status;
  EXPECT_EQ(room.id, map.info().id);
  EXPECT_EQ(room.title, map.info().name);
  EXPECT_EQ(room.revision, map.revision());
  EXPECT_EQ(room.keyframes, static_cast<std::int64_t>(map.keyframes().size()));
  EXPECT_EQ(room.points, static_cast<std::int64_t>(map.points().size()));
  EXPECT_EQ(room.file_bytes, static_cast<std::int64_t>(std::filesystem::file_size(directory_ + "/room.cairn")));
  EXPECT_FALSE(room.open) << "nobody has asked for it";
  EXPECT_FALSE(room.writing);
  ASSERT_TRUE(service_->Localize("room", Query()).ok());
  EXPECT_TRUE((*service_->List())[1].open);
}

TEST_P(MapServiceConformance, DescribesAMap) {
  const map::Snapshot& map = *TheConformanceMap().snapshot;
  const auto described = service_->Describe("room");
  ASSERT_TRUE(described.ok()) << described.status();
  EXPECT_EQ(described->summary.name, "room");
  EXPECT_EQ(described->summary.revision, map.revision());
  EXPECT_EQ(described->summary.keyframes, static_cast<std::int64_t>(map.keyframes().size()));
  EXPECT_GE(described->summary.format_version, 4);
  ASSERT_EQ(described->cameras.size(), 1u);
  EXPECT_EQ(described->cameras[0].camera, map.cameras().begin()->second.model);
  ASSERT_EQ(described->components.size(), 1u);
  const api::ComponentInfo& component = described->components[0];
  EXPECT_EQ(component.id, ComponentId(1));
  EXPECT_EQ(component.keyframes, static_cast<std::int64_t>(map.keyframes().size()));
  ASSERT_TRUE(component.world_from_component);
  EXPECT_EQ(component.world_from_component->scale(), 2.0);
  EXPECT_FALSE(component.joined_into);
  ASSERT_EQ(described->sessions.size(), map.sessions().size());
  EXPECT_EQ(described->sessions[0].id, map.sessions().begin()->first);
}

TEST_P(MapServiceConformance, GivesAnOverviewOfAMap) {
  const map::Snapshot& map = *TheConformanceMap().snapshot;
  const auto told = service_->Overview("room");
  ASSERT_TRUE(told.ok()) << told.status();
  EXPECT_EQ(told->summary.info.id, map.info().id);
  EXPECT_EQ(told->summary.revision, map.revision());
  EXPECT_EQ(told->summary.keyframes, static_cast<std::int64_t>(map.keyframes().size()));
  EXPECT_EQ(told->summary.points, static_cast<std::int64_t>(map.points().size()));
  ASSERT_EQ(told->cameras.size(), 1u);
  EXPECT_EQ(told->cameras[0], map.cameras().begin()->second);
  ASSERT_EQ(told->components.size(), 1u);
  EXPECT_EQ(told->components[0], map.components().begin()->second);
  ASSERT_EQ(told->sessions.size(), map.sessions().size());
  EXPECT_EQ(told->sessions[0], map.sessions().begin()->second);
  std::int64_t keyframes = 0, bytes = 0;
  for (const map::KeyframeShare& share : told->shares) keyframes += share.keyframes;
  for (const map::MapPart& part : told->parts) bytes += part.bytes;
  EXPECT_EQ(keyframes, told->summary.keyframes);
  EXPECT_EQ(bytes, told->summary.file_bytes);
  EXPECT_EQ(bytes, static_cast<std::int64_t>(std::filesystem::file_size(directory_ + "/room.cairn")));
  EXPECT_TRUE(told->quality.all);
  EXPECT_GT(told->quality.points, 0.0);
  EXPECT_GT(told->quality.error_rms_px, 0.0);
  EXPECT_TRUE(told->has_vocabulary);
  EXPECT_FALSE(told->being_written);
  EXPECT_EQ(service_->Overview("none").status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(service_->Overview("../room").status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_P(MapServiceConformance, NamesDoNotLeaveTheDirectory) {
  ASSERT_TRUE(WriteConformanceMap(directory_ + "_outside.cairn").ok());
  const std::string outside = std::filesystem::path(directory_).filename().string() + "_outside";
  std::error_code error;
  std::filesystem::create_symlink(directory_ + "_outside.cairn", directory_ + "/link.cairn", error);
  for (const std::string& name : {std::string(), std::string("../") + outside, directory_ + "/room",
                                  std::string("room/../room"), std::string("room\0x", 6), std::string(".")}) {
    EXPECT_EQ(service_->Describe(name).status().code(), absl::StatusCode::kInvalidArgument) << name;
    EXPECT_EQ(service_->Localize(name, Query()).status().code(), absl::StatusCode::kInvalidArgument) << name;
  }
  EXPECT_EQ(service_->Describe("link").status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(service_->List()->size(), 2u);
  std::filesystem::remove(directory_ + "_outside.cairn");
}

TEST_P(MapServiceConformance, ErrorsSayWhichAndKeepTheirFault) {
  const absl::Status missing = service_->Localize("kitchen", Query()).status();
  EXPECT_EQ(missing.code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(store::FaultOf(missing), store::Fault::kNotFound);
  EXPECT_THAT(std::string(missing.message()), testing::HasSubstr("kitchen"));
  const absl::Status broken = service_->Describe("broken").status();
  EXPECT_EQ(store::FaultOf(broken), store::Fault::kNotAMap) << broken;
  EXPECT_THAT(std::string(broken.message()), testing::HasSubstr("broken"));
  EXPECT_THAT(std::string(broken.message()), testing::Not(testing::HasSubstr(directory_)));
}

// The map that a name means is the one that lies there now.
TEST_P(MapServiceConformance, MapsComeGoAndAreReplaced) {
  ASSERT_TRUE(service_->Localize("room", Query()).ok());
  std::filesystem::remove(directory_ + "/room.cairn");
  EXPECT_EQ(service_->Localize("room", Query()).status().code(), absl::StatusCode::kNotFound);
  ASSERT_TRUE(WriteConformanceMap(directory_ + "/room.cairn").ok());
  ASSERT_TRUE(WriteConformanceMap(directory_ + "/other.cairn").ok());
  for (const char* name : {"room", "other"}) {
    const auto answer = service_->Localize(name, Query());
    ASSERT_TRUE(answer.ok()) << answer.status();
    EXPECT_TRUE(answer->localized) << answer->reason;
  }
}

TEST_P(MapServiceConformance, TracksAStream) {
  const Camera camera = Camera::FromPinhole(TheConformanceMap().pinhole);
  const auto tracker = service_->NewTracker("room", camera);
  ASSERT_TRUE(tracker.ok()) << tracker.status();
  for (int i = 0; i < 10; ++i) {
    const SE3 truth = LookInRoom({0.2 + 0.01 * i, 0.0, -1.4}, 0.05);
    const auto answer = (*tracker)->Track({TheConformanceMap().room.Render(camera, truth), (i + 1) * 33'333'333LL});
    ASSERT_TRUE(answer.ok()) << answer.status();
    EXPECT_NE(answer->state, api::TrackState::kLost) << answer->reason;
    EXPECT_LT((answer->map_from_camera.translation() - truth.Inverse().translation()).norm(), 0.03);
  }
  EXPECT_EQ(service_->NewTracker("kitchen", camera).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(service_->NewTracker("../room", camera).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(service_->NewTracker("room", Camera()).status().code(), absl::StatusCode::kInvalidArgument);
}

// A copy of the map, to the bit, that changes as the map does.
TEST_P(MapServiceConformance, FollowsAMap) {
  auto feed = service_->Follow("room", {});
  ASSERT_TRUE(feed.ok()) << feed.status();
  const auto first = (*feed)->Next(std::chrono::seconds(20));
  ASSERT_TRUE(first.ok() && *first) << first.status();
  EXPECT_TRUE((*first)->rows.whole);
  EXPECT_EQ(store::ContentDigest(*(*first)->map), store::ContentDigest(*TheConformanceMap().snapshot));
  EXPECT_EQ((*feed)->Vocabulary(), TheConformanceMap().vocabulary);
  auto writer = store::OpenMapStore(directory_ + "/room.cairn", store::OpenMode::kWrite);
  ASSERT_TRUE(writer.ok()) << writer.status();
  const auto map = *(*writer)->LoadSnapshot();
  map::Edit edit(map);
  edit.SetPose(KeyframeId(1),
               SE3(ExpSO3(Vector3d(0.0, 0.01, 0.0)), Vector3d::Zero()) * map->keyframe(KeyframeId(1)).camera_from_map);
  ASSERT_TRUE((*writer)->Commit(edit.Finish("moved")).ok());
  const auto change = (*feed)->Next(std::chrono::seconds(20));
  ASSERT_TRUE(change.ok() && *change) << change.status();
  EXPECT_FALSE((*change)->rows.whole);
  EXPECT_EQ((*change)->rows.base, map->revision());
  ASSERT_EQ((*change)->rows.keyframes.size(), 1u);
  EXPECT_EQ((*change)->rows.keyframes[0].id, KeyframeId(1));
  EXPECT_EQ(store::ContentDigest(*(*change)->map), *(*writer)->ContentDigest());
  EXPECT_TRUE(absl::IsNotFound(service_->Follow("kitchen", {}).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(service_->Follow("../room", {}).status()));
  EXPECT_FALSE(service_->Follow("broken", {}).ok());
}

// A walk along the wall, in steps that the odometry can follow.
inline SE3 SessionWalk(int frame) {
  const double t = 0.07 * frame;
  return LookInRoom({-1.2 + 1.2 * (1.0 - std::cos(t)), 0.2 * std::sin(2.0 * t), -1.4 + 0.3 * std::sin(0.7 * t)},
                    0.3 * std::sin(1.3 * t));
}

class MapSessionConformance : public MapServiceConformance {
 protected:
  static constexpr TimeNs kFrameNs = 33'333'333;

  static api::SessionRequest Request(const std::string& map, map::SessionPolicy policy) {
    api::SessionRequest request;
    request.map = map;
    request.policy = policy;
    request.camera = Camera::FromPinhole(TheConformanceMap().pinhole);
    request.source = "walk";
    request.first_ns = kFrameNs;
    return request;
  }
  static api::SessionFrame FrameOf(int frame) {
    const ConformanceMap& map = TheConformanceMap();
    return {map.room.Render(map.pinhole, SessionWalk(frame)), (frame + 1) * kFrameNs};
  }
  // The answers to frames `from` to `until`.
  static std::vector<api::SessionAnswer> Walk(api::MapSession& session, int from, int until) {
    std::vector<api::SessionAnswer> answers;
    for (int i = from; i < until; ++i) {
      const auto answer = session.AddFrame(FrameOf(i));
      EXPECT_TRUE(answer.ok()) << answer.status();
      if (!answer.ok()) break;
      EXPECT_EQ(answer->time_ns, (i + 1) * kFrameNs);
      EXPECT_EQ(answer->map_from_camera.has_value(), answer->reason.empty());
      answers.push_back(*answer);
    }
    return answers;
  }
};

TEST_P(MapSessionConformance, MakesAMapThatOthersUseAtOnce) {
  auto session = service_->StartSession(Request("fresh", map::SessionPolicy::kCreate));
  ASSERT_TRUE(session.ok()) << session.status();
  EXPECT_FALSE((*session)->token().empty());
  EXPECT_FALSE((*session)->last_answer());
  EXPECT_EQ(service_->Localize("fresh", Query()).status().code(), absl::StatusCode::kNotFound)
      << "it has no keyframe yet";
  const std::vector<api::SessionAnswer> answers = Walk(**session, 0, 180);
  ASSERT_EQ(answers.size(), 180u);
  EXPECT_EQ(answers[0].state, api::SessionState::kInitializing);
  EXPECT_TRUE(answers.back().map_from_camera) << answers.back().reason;
  const api::SessionProgress progress = (*session)->progress();
  EXPECT_GT(progress.revision, 0u);
  EXPECT_GT(progress.keyframes, 0);
  ASSERT_TRUE(progress.durable_ns);
  EXPECT_GT(*progress.durable_ns, 0);
  EXPECT_LE(*progress.durable_ns, answers.back().time_ns);
  const auto described = service_->Describe("fresh");
  ASSERT_TRUE(described.ok()) << described.status();
  EXPECT_TRUE(described->summary.writing);
  EXPECT_GE(described->summary.revision, progress.revision) << "what was told is durable";

  const auto summary = (*session)->Finish();
  ASSERT_TRUE(summary.ok()) << summary.status();
  EXPECT_EQ(summary->frames, 180);
  EXPECT_GT(summary->frames_tracked, 120);
  EXPECT_EQ(summary->result, map::SessionResult::kCreated);
  EXPECT_EQ(static_cast<std::int64_t>(summary->poses.size()), summary->frames_tracked);
  EXPECT_EQ(summary->session, progress.session);
  session->reset();
  const auto after = service_->Describe("fresh");
  ASSERT_TRUE(after.ok()) << after.status();
  EXPECT_FALSE(after->summary.writing);
  EXPECT_EQ(after->summary.revision, summary->revision);
  EXPECT_EQ(after->summary.title, "walk");
  ASSERT_EQ(after->sessions.size(), 1u);
  EXPECT_TRUE(after->sessions[0].complete);
  const auto answer = service_->Localize("fresh", Query());
  ASSERT_TRUE(answer.ok()) << answer.status();
  EXPECT_TRUE(answer->localized) << answer->reason;
}

TEST_P(MapSessionConformance, ExtendsAMapAndIsFoundInIt) {
  const Revision before = service_->Describe("room")->summary.revision;
  auto session = service_->StartSession(Request("room", map::SessionPolicy::kExtend));
  ASSERT_TRUE(session.ok()) << session.status();
  Walk(**session, 0, 180);
  ASSERT_TRUE((*session)->progress().located_ns);
  EXPECT_EQ((*session)->progress().located_component, ComponentId(1));
  const auto summary = (*session)->Finish();
  ASSERT_TRUE(summary.ok()) << summary.status();
  const auto described = service_->Describe("room");
  ASSERT_TRUE(described.ok()) << described.status();
  EXPECT_GT(described->summary.revision, before);
  EXPECT_EQ(described->sessions.back().policy, map::SessionPolicy::kExtend);
  EXPECT_EQ(described->sessions.back().id, summary->session);
  EXPECT_TRUE(described->sessions.back().complete);
}

TEST_P(MapSessionConformance, GoesOnWhereItWasLetGo) {
  auto session = service_->StartSession(Request("fresh", map::SessionPolicy::kCreate));
  ASSERT_TRUE(session.ok()) << session.status();
  const std::vector<api::SessionAnswer> first = Walk(**session, 0, 100);
  const std::string token = (*session)->token();
  const SessionId id = (*session)->progress().session;
  EXPECT_EQ(service_->ResumeSession(token).status().code(), absl::StatusCode::kFailedPrecondition) << "it is held";
  session->reset();
  EXPECT_EQ(service_->ResumeSession("0123456789abcdef").status().code(), absl::StatusCode::kNotFound);
  absl::StatusOr<std::unique_ptr<api::MapSession>> resumed = absl::UnknownError("not tried");
  do {  // the server may take a moment to notice
    resumed = service_->ResumeSession(token);
  } while (absl::IsFailedPrecondition(resumed.status()));
  ASSERT_TRUE(resumed.ok()) << resumed.status();
  ASSERT_TRUE((*resumed)->last_answer());
  EXPECT_EQ((*resumed)->last_answer()->time_ns, first.back().time_ns);
  EXPECT_EQ((*resumed)->token(), token);
  EXPECT_EQ((*resumed)->camera(), Camera::FromPinhole(TheConformanceMap().pinhole));
  const std::vector<api::SessionAnswer> rest = Walk(**resumed, 100, 180);
  EXPECT_TRUE(rest.back().map_from_camera) << rest.back().reason;
  EXPECT_EQ((*resumed)->progress().session, id) << "the same session";
  const auto summary = (*resumed)->Finish();
  ASSERT_TRUE(summary.ok()) << summary.status();
  EXPECT_EQ(summary->frames, 180);
  const auto again = service_->ResumeSession(token);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_EQ((*again)->AddFrame(FrameOf(180)).status().code(), absl::StatusCode::kFailedPrecondition) << "it has ended";
  const auto echo = service_->ResumeSession(token);
  ASSERT_TRUE(echo.ok()) << echo.status();
  const auto told = (*echo)->Finish();
  ASSERT_TRUE(told.ok()) << told.status();
  EXPECT_EQ(told->revision, summary->revision) << "said once more, as the connection may have broken";
  EXPECT_EQ(told->poses.size(), summary->poses.size());
}

TEST_P(MapSessionConformance, FramesThatCannotBeUsedAreSkipped) {
  auto session = service_->StartSession(Request("fresh", map::SessionPolicy::kCreate));
  ASSERT_TRUE(session.ok()) << session.status();
  Walk(**session, 0, 3);
  api::SessionFrame bad = FrameOf(3);
  bad.time_ns = kFrameNs;
  EXPECT_EQ((*session)->AddFrame(bad).status().code(), absl::StatusCode::kInvalidArgument) << "an older time";
  bad = FrameOf(3);
  bad.image = bad.image(cv::Rect(0, 0, 100, 100)).clone();
  EXPECT_EQ((*session)->AddFrame(bad).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ((*session)->AddFrame({cv::Mat(), 4 * kFrameNs}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(Walk(**session, 3, 6).size(), 3u);
  const absl::Status nothing = (*session)->Finish().status();
  EXPECT_EQ(nothing.code(), absl::StatusCode::kFailedPrecondition) << nothing;
  EXPECT_THAT(std::string(nothing.message()), testing::HasSubstr("no map was made"));
  EXPECT_EQ(service_->Describe("fresh").status().code(), absl::StatusCode::kNotFound);
}

TEST_P(MapSessionConformance, PoliciesAndCamerasThatDoNotFitAreRefused) {
  const auto refused = [&](const api::SessionRequest& request) {
    return service_->StartSession(request).status().code();
  };
  EXPECT_EQ(refused(Request("room", map::SessionPolicy::kCreate)), absl::StatusCode::kAlreadyExists);
  EXPECT_EQ(refused(Request("fresh", map::SessionPolicy::kExtend)), absl::StatusCode::kNotFound);
  EXPECT_EQ(refused(Request("../fresh", map::SessionPolicy::kCreate)), absl::StatusCode::kInvalidArgument);
  api::SessionRequest bad = Request("fresh", map::SessionPolicy::kCreate);
  bad.camera.fx_px = -1.0;
  EXPECT_EQ(refused(bad), absl::StatusCode::kInvalidArgument);
  api::SessionRequest other = Request("room", map::SessionPolicy::kExtend);
  other.map_id = "0123456789abcdef0123456789abcdef";
  EXPECT_EQ(refused(other), absl::StatusCode::kAborted) << "another map than the one that is meant";
  other.map_id.clear();
  other.least_revision = 1000;
  EXPECT_EQ(refused(other), absl::StatusCode::kAborted) << "an older copy of it";
  EXPECT_EQ(service_->List()->size(), 2u) << "nothing was left behind";
}

}  // namespace cairn::conformance

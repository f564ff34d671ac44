// What those who keep maps may ask of every api::MapService; as map_service_conformance.h, which it goes on from.
#pragma once

#include <string>
#include <vector>

#include "client/conformance/map_service_conformance.h"
#include "map/geo_pose.h"
#include "store/map_store.h"

namespace cairn::conformance {

class MapAdminConformance : public MapSessionConformance {
 protected:
  // Poses of the keyframes in a world turned by a right angle, three times as large, and moved.
  static Sim3 NewWorld() { return {ExpSO3(Vector3d(0.0, 0.0, M_PI / 2)), Vector3d(1.0, 2.0, 3.0), 3.0}; }
  static api::AlignRequest PosesOfKeyframes() {
    api::ReferencePoses reference;
    TheConformanceMap().snapshot->keyframes().ForEach([&](const auto& keyframe) {
      reference.poses.push_back({keyframe->time_ns, NewWorld().TransformPose(keyframe->camera_from_map.Inverse())});
    });
    api::AlignRequest request;
    request.by = reference;
    request.source = "truth.txt";
    return request;
  }
  std::vector<std::string> Names() {
    std::vector<std::string> names;
    const auto maps = service_->List();
    EXPECT_TRUE(maps.ok()) << maps.status();
    for (const api::MapSummary& map : *maps) names.push_back(map.name);
    return names;
  }
  absl::StatusOr<std::string> Exported(const std::string& map, api::ExportContent content) {
    std::string file;
    CAIRN_RETURN_IF_ERROR(service_->Export(map, content, [&](absl::string_view part) {
      file.append(part.data(), part.size());
      return absl::OkStatus();
    }));
    return file;
  }
};

TEST_P(MapAdminConformance, CopiesAMap) {
  const auto copy = service_->Snapshot("room", "backup");
  ASSERT_TRUE(copy.ok()) << copy.status();
  EXPECT_EQ(copy->name, "backup");
  EXPECT_EQ(copy->id, TheConformanceMap().snapshot->info().id);
  EXPECT_EQ(copy->keyframes, 10);
  EXPECT_THAT(Names(), testing::ElementsAre("backup", "broken", "room"));
  const auto answer = service_->Localize("backup", Query());
  ASSERT_TRUE(answer.ok()) << answer.status();
  EXPECT_TRUE(answer->localized) << answer->reason;
  const absl::Status again = service_->Snapshot("room", "backup").status();
  EXPECT_EQ(store::FaultOf(again), store::Fault::kExists) << again;
  EXPECT_EQ(service_->Snapshot("kitchen", "x").status().code(), absl::StatusCode::kNotFound);
  for (const char* name : {"", "../x", "a/b", ".hidden", "/tmp/x"}) {
    EXPECT_EQ(service_->Snapshot("room", name).status().code(), absl::StatusCode::kInvalidArgument) << name;
    EXPECT_EQ(service_->Snapshot(name, "x").status().code(), absl::StatusCode::kInvalidArgument) << name;
  }
}

TEST_P(MapAdminConformance, DeletesToTheTrashAndRestores) {
  ASSERT_TRUE(service_->Localize("room", Query()).ok()) << "it is open";
  EXPECT_TRUE(service_->ListDeleted()->empty());
  const auto deleted = service_->Delete("room");
  ASSERT_TRUE(deleted.ok()) << deleted.status();
  EXPECT_EQ(service_->Localize("room", Query()).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(service_->Delete("room").status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(Names(), testing::ElementsAre("broken"));
  const auto trash = service_->ListDeleted();
  ASSERT_TRUE(trash.ok()) << trash.status();
  ASSERT_EQ(trash->size(), 1u);
  EXPECT_EQ(trash->front().deleted, *deleted);
  EXPECT_EQ(trash->front().map, "room");
  EXPECT_GT(trash->front().file_bytes, 0);
  EXPECT_GT(trash->front().deleted_unix_ns, 0);

  EXPECT_EQ(*service_->Restore(*deleted, "again"), "again");
  EXPECT_TRUE(service_->ListDeleted()->empty());
  EXPECT_TRUE(service_->Localize("again", Query())->localized);
  EXPECT_EQ(service_->Restore(*deleted, "").status().code(), absl::StatusCode::kNotFound);
  const std::string back = *service_->Delete("again");
  ASSERT_TRUE(WriteConformanceMap(directory_ + "/again.cairn").ok());
  EXPECT_EQ(store::FaultOf(service_->Restore(back, "").status()), store::Fault::kExists);
  EXPECT_EQ(*service_->Restore(back, "room"), "room");
  EXPECT_TRUE(service_->Delete("broken").ok()) << "also what is no map";
  for (const char* name : {"", "../room.1", "room", "room.x", ".1", "a/b.1"}) {
    EXPECT_EQ(service_->Restore(name, "").status().code(), absl::StatusCode::kInvalidArgument) << name;
  }
  for (const char* name : {"", "../room", "a/b", ".trash"}) {
    EXPECT_EQ(service_->Delete(name).status().code(), absl::StatusCode::kInvalidArgument) << name;
  }
}

TEST_P(MapAdminConformance, WhileASessionWrites) {
  auto session = service_->StartSession(Request("room", map::SessionPolicy::kExtend));
  ASSERT_TRUE(session.ok()) << session.status();
  const std::vector<api::SessionAnswer> answers = Walk(**session, 0, 120);
  ASSERT_EQ(answers.size(), 120u);
  const Revision durable = (*session)->progress().revision;
  EXPECT_GT(durable, 1u);
  const auto sessions = service_->Sessions("room");
  ASSERT_TRUE(sessions.ok()) << sessions.status();
  ASSERT_EQ(sessions->size(), 1u);
  EXPECT_EQ(sessions->front().map, "room");
  EXPECT_EQ(sessions->front().source, "walk");
  EXPECT_EQ(sessions->front().frames, 120);
  EXPECT_EQ(sessions->front().state, answers.back().state);
  EXPECT_EQ(sessions->front().progress.session, (*session)->progress().session);
  EXPECT_FALSE(sessions->front().waiting);
  EXPECT_GT(sessions->front().running_s, sessions->front().silent_s);
  EXPECT_EQ(service_->Sessions("")->size(), 1u);

  EXPECT_EQ(service_->RemoveSession("room", (*session)->progress().session).status().code(),
            absl::StatusCode::kFailedPrecondition);
  const absl::Status refused = service_->Delete("room").status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kFailedPrecondition) << refused;
  EXPECT_THAT(std::string(refused.message()), testing::HasSubstr("1 session"));
  const auto copy = service_->Snapshot("room", "backup");
  ASSERT_TRUE(copy.ok()) << copy.status();
  EXPECT_GE(copy->revision, durable);
  const auto verified = service_->Verify("backup", api::VerifyDepth::kStored);
  ASSERT_TRUE(verified.ok()) << verified.status();
  EXPECT_THAT(verified->findings, testing::IsEmpty());
  const auto aligned = service_->Align("room", [] {
    api::AlignRequest request;
    request.by = map::GeoAnchor{60.0, 25.0, 30.0, Quaterniond::Identity()};
    return request;
  }());
  ASSERT_TRUE(aligned.ok()) << aligned.status();
  EXPECT_GT(aligned->revision, durable) << "durable, among the session's own changes";
  Walk(**session, 120, 180);
  ASSERT_TRUE((*session)->Finish().ok());
  session->reset();
  EXPECT_TRUE(service_->Sessions("room")->empty());
  EXPECT_TRUE(service_->Describe("room")->summary.geo_anchor) << "the session did not take it away";
  EXPECT_TRUE(service_->Delete("room").ok());
  EXPECT_EQ(service_->Sessions("room").status().code(), absl::StatusCode::kNotFound);
}

TEST_P(MapAdminConformance, MakesAnEmptyMapThatASessionFills) {
  const auto created = service_->Create("fresh", "the new hall");
  ASSERT_TRUE(created.ok()) << created.status();
  EXPECT_EQ(created->title, "the new hall");
  EXPECT_EQ(created->keyframes, 0);
  EXPECT_EQ(store::FaultOf(service_->Create("fresh", "").status()), store::Fault::kExists);
  EXPECT_EQ(service_->Create("../fresh", "").status().code(), absl::StatusCode::kInvalidArgument);
  const auto nothing = service_->Localize("fresh", Query());
  ASSERT_TRUE(nothing.ok()) << nothing.status();
  EXPECT_FALSE(nothing->localized);
  auto session = service_->StartSession(Request("fresh", map::SessionPolicy::kExtend));
  ASSERT_TRUE(session.ok()) << session.status();
  Walk(**session, 0, 180);
  const auto summary = (*session)->Finish();
  ASSERT_TRUE(summary.ok()) << summary.status();
  session->reset();
  EXPECT_GT(service_->Describe("fresh")->summary.keyframes, 0);
  EXPECT_TRUE(service_->Localize("fresh", Query())->localized);
}

TEST_P(MapAdminConformance, VerifiesMaps) {
  const auto good = service_->Verify("room", api::VerifyDepth::kDeep);
  ASSERT_TRUE(good.ok()) << good.status();
  EXPECT_THAT(good->findings, testing::IsEmpty());
  ASSERT_TRUE(good->summary);
  EXPECT_EQ(good->summary->name, "room");
  EXPECT_EQ(good->summary->keyframes, 10);
  EXPECT_EQ(store::FaultOf(service_->Verify("broken", api::VerifyDepth::kStored).status()), store::Fault::kNotAMap);
  EXPECT_EQ(service_->Verify("kitchen", api::VerifyDepth::kStored).status().code(), absl::StatusCode::kNotFound);
}

TEST_P(MapAdminConformance, TellsWhatHasChangedAMap) {
  ASSERT_TRUE(service_
                  ->Align("room",
                          [] {
                            auto request = PosesOfKeyframes();
                            request.overwrite = request.force = true;
                            return request;
                          }())
                  .ok());
  const auto log = service_->Log("room", {});
  ASSERT_TRUE(log.ok()) << log.status();
  EXPECT_EQ(log->revision, 2u);
  ASSERT_EQ(log->changes.size(), 2u);
  EXPECT_EQ(log->changes[0].revision, 2u);
  EXPECT_EQ(log->changes[0].reason, "align component 1 to the world");
  EXPECT_THAT(log->changes[0].components, testing::ElementsAre(ComponentId(1)));
  EXPECT_EQ(log->changes[1].keyframes_put, 10);
  map::ChangeQuery newest;
  newest.max_count = 1;
  EXPECT_EQ(service_->Log("room", newest)->changes.size(), 1u);
  map::ChangeQuery of_nobody;
  of_nobody.session = SessionId(9);
  EXPECT_EQ(service_->Log("room", of_nobody).status().code(), absl::StatusCode::kNotFound);
}

TEST_P(MapAdminConformance, TakesASessionOut) {
  EXPECT_EQ(service_->RemoveSession("room", SessionId(9)).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(service_->RemoveSession("kitchen", SessionId(1)).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(service_->RemoveSession("../room", SessionId(1)).status().code(), absl::StatusCode::kInvalidArgument);
  const auto removal = service_->RemoveSession("room", SessionId(1));
  ASSERT_TRUE(removal.ok()) << removal.status();
  EXPECT_EQ(removal->revision, 2u);
  EXPECT_EQ(removal->keyframes, 10);
  EXPECT_GT(removal->points, 100);
  EXPECT_THAT(removal->removed_components, testing::ElementsAre(ComponentId(1)));
  const auto described = service_->Describe("room");
  ASSERT_TRUE(described.ok()) << described.status();
  EXPECT_EQ(described->summary.keyframes, 0);
  EXPECT_TRUE(described->sessions.at(0).removed);
  EXPECT_FALSE(service_->Localize("room", Query())->localized);
  EXPECT_THAT(service_->Verify("room", api::VerifyDepth::kDeep)->findings, testing::IsEmpty());
  EXPECT_EQ(service_->RemoveSession("room", SessionId(1)).status().code(), absl::StatusCode::kFailedPrecondition);
}

TEST_P(MapAdminConformance, AlignsByPoses) {
  api::AlignRequest request = PosesOfKeyframes();
  EXPECT_EQ(service_->Align("room", request).status().code(), absl::StatusCode::kAlreadyExists);
  request.overwrite = true;
  const absl::Status contradicted = service_->Align("room", request).status();
  EXPECT_EQ(contradicted.code(), absl::StatusCode::kFailedPrecondition) << "another scale";
  EXPECT_THAT(std::string(contradicted.message()), testing::HasSubstr("truth.txt"));
  request.force = true;
  const auto answer = service_->Align("room", request);
  ASSERT_TRUE(answer.ok()) << answer.status();
  EXPECT_EQ(answer->revision, 2u);
  EXPECT_FALSE(answer->geo_anchor);
  ASSERT_TRUE(answer->component);
  EXPECT_EQ(answer->component->component, ComponentId(1));
  EXPECT_EQ(answer->component->with_reference, 10);
  EXPECT_EQ(answer->component->fitting, 10);
  EXPECT_EQ(answer->component->orientations.kind, OrientationKind::kCamera);
  EXPECT_TRUE(answer->component->orientations_used);
  EXPECT_NEAR(answer->component->world_from_component.scale(), 3.0, 1e-6);
  EXPECT_GT(answer->component->moved_m.value_or(0.0), 1.0);
  const Sim3 stored = *service_->Describe("room")->components[0].world_from_component;
  EXPECT_LT((stored.translation() - NewWorld().translation()).norm(), 1e-5);
  EXPECT_EQ(stored.translation(), answer->component->world_from_component.translation());
  std::get<api::ReferencePoses>(request.by).poses.clear();
  EXPECT_EQ(service_->Align("room", request).status().code(), absl::StatusCode::kInvalidArgument);
  request.component = ComponentId(7);
  request.by = PosesOfKeyframes().by;
  EXPECT_EQ(service_->Align("room", request).status().code(), absl::StatusCode::kNotFound);
}

TEST_P(MapAdminConformance, PlacesAMapOnTheEarth) {
  EXPECT_FALSE(service_->Describe("room")->summary.geo_anchor);
  api::AlignRequest request;
  const map::GeoAnchor anchor{60.1699, 24.9384, 30.0, Quaterniond(ExpSO3(Vector3d(0.0, 0.0, 0.5)))};
  request.by = anchor;
  const auto answer = service_->Align("room", request);
  ASSERT_TRUE(answer.ok()) << answer.status();
  EXPECT_FALSE(answer->component);
  EXPECT_TRUE(answer->geo_anchor_changed);
  const auto stored = service_->Describe("room")->summary.geo_anchor;
  ASSERT_TRUE(stored);
  EXPECT_EQ(stored->latitude_deg, anchor.latitude_deg);
  EXPECT_EQ(stored->longitude_deg, anchor.longitude_deg);
  EXPECT_EQ(stored->height_m, anchor.height_m);
  EXPECT_EQ(stored->enu_from_world.coeffs(), anchor.enu_from_world.coeffs());
  const auto listed = service_->List();
  EXPECT_TRUE(listed->back().geo_anchor) << "also without opening it";
  EXPECT_EQ(service_->Align("room", request).status().code(), absl::StatusCode::kAlreadyExists);
  request.by = map::GeoAnchor{91.0, 0.0, 0.0, Quaterniond::Identity()};
  EXPECT_EQ(service_->Align("room", request).status().code(), absl::StatusCode::kInvalidArgument);
  request.by = api::NoGeoAnchor();
  EXPECT_TRUE(service_->Align("room", request)->geo_anchor_changed);
  EXPECT_FALSE(service_->Describe("room")->summary.geo_anchor);
}

TEST_P(MapAdminConformance, ScalesAMapByAKnownDistance) {
  const map::Snapshot& map = *TheConformanceMap().snapshot;
  std::vector<KeyframeId> ids;
  map.keyframes().ForEach([&](const auto& keyframe) { ids.push_back(keyframe->id); });
  api::KnownPlaces known;
  known.distances = {{ids.front(), ids.back(), 12.5}};
  api::AlignRequest request;
  request.by = known;
  EXPECT_EQ(service_->Align("room", request).status().code(), absl::StatusCode::kAlreadyExists);
  request.overwrite = true;
  EXPECT_EQ(service_->Align("room", request).status().code(), absl::StatusCode::kFailedPrecondition) << "another scale";
  request.force = true;
  const auto answer = service_->Align("room", request);
  ASSERT_TRUE(answer.ok()) << answer.status();
  ASSERT_TRUE(answer->component);
  EXPECT_THAT(answer->component->errors_m, ::testing::ElementsAre(::testing::DoubleNear(0.0, 1e-9)));
  const Sim3& world = answer->component->world_from_component;
  const Vector3d from = world * map.keyframe(ids.front()).CenterInMap();
  EXPECT_NEAR((world * map.keyframe(ids.back()).CenterInMap() - from).norm(), 12.5, 1e-9);
  EXPECT_TRUE(answer->component->moved_m);
  std::get<api::KnownPlaces>(request.by).distances[0].to = PointId(1'000'000);
  EXPECT_EQ(service_->Align("room", request).status().code(), absl::StatusCode::kNotFound);
  request.by = api::KnownPlaces();
  EXPECT_EQ(service_->Align("room", request).status().code(), absl::StatusCode::kInvalidArgument);
}

// Positions of keyframes of a map that is aligned find where its world is.
TEST_P(MapAdminConformance, PlacesAMapByPositionsOfItsKeyframes) {
  const map::GeoAnchor truth{60.1699, 24.9384, 30.0, Quaterniond(ExpSO3(Vector3d(0.1, -0.2, 2.5)))};
  const map::Snapshot& map = *TheConformanceMap().snapshot;
  api::GeoPositions positions;
  map.keyframes().ForEach([&](const auto& keyframe) {
    const Vector3d center = *map.WorldFrom(keyframe->component) * keyframe->CenterInMap();
    // Half of them by time, half by number.
    const bool by_number = keyframe->id.value() % 2 == 0;
    positions.positions.push_back({by_number ? keyframe->id : KeyframeId(),
                                   by_number ? 0 : keyframe->time_ns + 5'000'000,
                                   map::GeoPoseOf(truth, SE3(Quaterniond::Identity(), center)).position});
  });
  api::AlignRequest request;
  request.by = positions;
  request.source = "gnss.txt";
  // They lie almost on a line: what they leave open is refused, or forced.
  const auto answer = [&] {
    auto tried = service_->Align("room", request);
    request.force = true;
    return tried.ok() ? tried : service_->Align("room", request);
  }();
  ASSERT_TRUE(answer.ok()) << answer.status();
  ASSERT_TRUE(answer->geo_anchor);
  EXPECT_LT(answer->geo_anchor->enu_from_world.angularDistance(truth.enu_from_world), 1e-6);
  EXPECT_NEAR(answer->geo_anchor->latitude_deg, truth.latitude_deg, 1e-11);
  EXPECT_NEAR(answer->geo_anchor->longitude_deg, truth.longitude_deg, 1e-11);
  EXPECT_NEAR(answer->geo_anchor->height_m, truth.height_m, 1e-5);
  ASSERT_TRUE(answer->component);
  EXPECT_EQ(answer->component->with_reference, 10);
  EXPECT_LT(answer->component->rmse_all_m, 1e-5);
  EXPECT_EQ(answer->component->world_from_component.scale(), 2.0) << "the world is as it was";
  positions.positions.resize(2);
  request.by = positions;
  EXPECT_EQ(service_->Align("room", request).status().code(), absl::StatusCode::kInvalidArgument);
  positions.positions.push_back({KeyframeId(99), 0, {}});
  request.by = positions;
  EXPECT_EQ(service_->Align("room", request).status().code(), absl::StatusCode::kNotFound);
}

TEST_P(MapAdminConformance, ExportsFiles) {
  const auto map = Exported("room", api::ExportContent::kMap);
  ASSERT_TRUE(map.ok()) << map.status();
  std::ofstream(directory_ + "/copy.cairn", std::ios::binary) << *map;
  EXPECT_TRUE(service_->Localize("copy", Query())->localized);
  const auto trajectory = Exported("room", api::ExportContent::kTrajectory);
  ASSERT_TRUE(trajectory.ok()) << trajectory.status();
  EXPECT_THAT(*trajectory, testing::StartsWith("# keyframes of map conformance, revision 1, frame world, metres\n"));
  EXPECT_EQ(std::count(trajectory->begin(), trajectory->end(), '\n'), 12) << "two of them comments";
  const auto points = Exported("room", api::ExportContent::kPoints);
  ASSERT_TRUE(points.ok()) << points.status();
  EXPECT_THAT(*points, testing::StartsWith("ply\n"));
  EXPECT_THAT(*points,
              testing::HasSubstr(absl::StrCat("element vertex ", TheConformanceMap().snapshot->points().size(), "\n")));
  EXPECT_EQ(Exported("kitchen", api::ExportContent::kMap).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(store::FaultOf(Exported("broken", api::ExportContent::kPoints).status()), store::Fault::kNotAMap);
  const absl::Status enough = service_->Export(
      "room", api::ExportContent::kMap, [](absl::string_view) { return absl::ResourceExhaustedError("no room"); });
  EXPECT_EQ(enough.code(), absl::StatusCode::kResourceExhausted) << enough;
  for (const auto& entry : std::filesystem::directory_iterator(directory_)) {
    EXPECT_THAT(entry.path().filename().string(), testing::Not(testing::HasSubstr("export"))) << "nothing is left";
  }
}

TEST_P(MapAdminConformance, LocalizesInSeveralMaps) {
  ASSERT_TRUE(WriteConformanceMap(directory_ + "/copy.cairn").ok());
  ASSERT_TRUE(service_->Create("empty", "").ok());
  const auto all = service_->LocalizeAcross({}, Query());
  ASSERT_TRUE(all.ok()) << all.status();
  EXPECT_EQ(all->map, "copy") << "a copy is no rival";
  EXPECT_FALSE(all->ambiguous);
  std::vector<std::string> order;
  for (const api::AnswerOfMap& answer : all->answers) order.push_back(answer.map);
  EXPECT_THAT(order, testing::ElementsAre("copy", "room", "broken", "empty"));
  EXPECT_EQ(store::FaultOf(all->answers[2].status), store::Fault::kNotAMap);
  EXPECT_TRUE(all->answers[3].status.ok());
  ASSERT_NE(all->located(), nullptr);
  EXPECT_EQ(all->located()->inliers, service_->Localize("copy", Query())->inliers);
  const auto some = service_->LocalizeAcross({"room", "empty", "room"}, Query());
  ASSERT_TRUE(some.ok()) << some.status();
  EXPECT_EQ(some->map, "room");
  EXPECT_EQ(some->answers.size(), 2u);
  // Made once more, it is another map that is as good.
  map::MapInfo info = TheConformanceMap().snapshot->info();
  info.id = std::string(32, 'a');
  map::Delta delta = TheConformanceMap().delta;
  delta.info.reset();
  store::CreateOptions options;
  options.vocabulary = TheConformanceMap().vocabulary;
  auto again = store::CreateMapStore(directory_ + "/again.cairn", info, options);
  ASSERT_TRUE(again.ok()) << again.status();
  ASSERT_TRUE((*again)->Commit(delta).ok());
  ASSERT_TRUE((*again)->Close().ok());
  const auto open = service_->LocalizeAcross({"room", "empty", "again"}, Query());
  ASSERT_TRUE(open.ok()) << open.status();
  EXPECT_TRUE(open->ambiguous);
  EXPECT_EQ(open->located(), nullptr);
  EXPECT_THAT(open->rivals, testing::ElementsAre("again", "room"));
  const auto nowhere = service_->LocalizeAcross({"empty"}, Query());
  ASSERT_TRUE(nowhere.ok()) << nowhere.status();
  EXPECT_EQ(nowhere->located(), nullptr);
  // One that is not there is told, and the others answer; if none of them is there, that is an error.
  const auto without = service_->LocalizeAcross({"room", "kitchen"}, Query());
  ASSERT_TRUE(without.ok()) << without.status();
  EXPECT_EQ(without->map, "room");
  ASSERT_EQ(without->answers.size(), 2u);
  EXPECT_EQ(without->answers[1].map, "kitchen");
  EXPECT_EQ(without->answers[1].status.code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(service_->LocalizeAcross({"kitchen", "cellar"}, Query()).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(service_->LocalizeAcross({"../room"}, Query()).status().code(), absl::StatusCode::kInvalidArgument);
  api::LocalizeQuery bad = Query();
  bad.camera.fx_px = -1.0;
  EXPECT_EQ(service_->LocalizeAcross({}, bad).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace cairn::conformance

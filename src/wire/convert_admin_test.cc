#include "wire/convert_admin.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "wire/convert.h"
#include "wire/convert_alignment.h"
#include "wire/convert_overview.h"
#include "wire/convert_status.h"
#include "wire/testing_messages.h"

namespace cairn::wire {
namespace {

TEST(ConvertAdmin, Overviews) {
  map::MapOverview overview;
  overview.summary.format_version = 4;
  overview.summary.revision = 17;
  overview.summary.info.id = "0123456789abcdef0123456789abcdef";
  overview.summary.info.vocabulary_hash = 5;
  overview.summary.keyframes = 20;
  overview.summary.points = 30;
  overview.summary.file_bytes = 4000;
  map::MapCamera camera;
  camera.id = CameraId(2);
  camera.model =
      Camera::FromPinhole({.width_px = 64, .height_px = 48, .fx_px = 50, .fy_px = 51, .cx_px = 32, .cy_px = 24});
  camera.pinhole = {.width_px = 64, .height_px = 48, .fx_px = 50, .fy_px = 51, .cx_px = 32, .cy_px = 24};
  camera.lens = LensCorrection{1.01, 0.02, -0.003};
  overview.cameras = {camera};
  map::Session session;
  session.id = SessionId(3);
  session.source = "kitchen";
  session.trajectory = map::ReportedTrajectory{true, 5, 4, "why"};
  overview.sessions = {session};
  overview.components = {{.id = ComponentId(1), .session = SessionId(3)}};
  overview.shares = {{SessionId(3), ComponentId(1), 20, 100, 200}};
  overview.parts = {{"descriptors", 3000}, {"rest", 1000}};
  overview.quality = {12, false, 1, 2, 3, 4, 5, 6, 7};
  overview.has_vocabulary = overview.being_written = true;
  overview.notes = {"a note"};
  v1::OverviewMapResponse message;
  ToProto(overview, &message);
  const auto back = FromProto(OverTheWire(message));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->summary.format_version, 4);
  EXPECT_EQ(back->summary.revision, 17u);
  EXPECT_EQ(back->summary.info.id, overview.summary.info.id);
  EXPECT_EQ(back->summary.info.vocabulary_hash, 5u);
  EXPECT_EQ(back->summary.keyframes, 20);
  EXPECT_EQ(back->summary.points, 30);
  EXPECT_EQ(back->summary.file_bytes, 4000);
  EXPECT_EQ(back->cameras, overview.cameras);
  EXPECT_EQ(back->sessions, overview.sessions);
  EXPECT_EQ(back->components, overview.components);
  ASSERT_EQ(back->shares.size(), 1u);
  EXPECT_EQ(back->shares[0].session, SessionId(3));
  EXPECT_EQ(back->shares[0].component, ComponentId(1));
  EXPECT_EQ(back->shares[0].keyframes, 20);
  EXPECT_EQ(back->shares[0].first_ns, 100);
  EXPECT_EQ(back->shares[0].last_ns, 200);
  ASSERT_EQ(back->parts.size(), 2u);
  EXPECT_EQ(back->parts[0].name, "descriptors");
  EXPECT_EQ(back->parts[1].bytes, 1000);
  const map::MapQuality& quality = back->quality;
  EXPECT_EQ(quality.keyframes, 12);
  EXPECT_FALSE(quality.all);
  EXPECT_THAT((std::vector{quality.features, quality.points, quality.covisible, quality.observations_per_point}),
              testing::ElementsAre(1, 2, 3, 4));
  EXPECT_EQ(quality.error_keyframes, 5);
  EXPECT_EQ(quality.error_rms_px, 6);
  EXPECT_EQ(quality.error_median_px, 7);
  EXPECT_TRUE(back->has_vocabulary);
  EXPECT_TRUE(back->being_written);
  EXPECT_THAT(back->notes, testing::ElementsAre("a note"));
  message.mutable_cameras(0)->mutable_pinhole()->set_width_px(-1);
  EXPECT_FALSE(FromProto(message).ok());
}

TEST(ConvertAdmin, VerificationsAndLogs) {
  api::MapVerification verified;
  verified.summary.emplace();
  verified.summary->name = "office";
  verified.summary->geo_anchor = map::GeoAnchor{60.0, 25.0, 30.0, Quaterniond(ExpSO3(Vector3d(0.1, 0.2, 0.3)))};
  verified.findings = {{"points", 12, "is damaged"}};
  verified.notes = {"a note"};
  v1::VerifyMapResponse message;
  ToProto(verified, &message);
  const auto back = FromProto(OverTheWire(message));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->summary->name, "office");
  EXPECT_EQ(back->summary->geo_anchor->enu_from_world.coeffs(), verified.summary->geo_anchor->enu_from_world.coeffs());
  EXPECT_EQ(back->findings[0].table, "points");
  EXPECT_EQ(back->findings[0].id, 12);
  EXPECT_EQ(back->findings[0].message, "is damaged");
  EXPECT_THAT(back->notes, testing::ElementsAre("a note"));

  api::MapLog log;
  log.revision = 7;
  map::LoggedChange change;
  change.revision = 7;
  change.reason = "why";
  change.session = SessionId(3);
  change.committed_unix_ns = 99;
  change.components = {ComponentId(1), ComponentId(4)};
  std::int64_t number = 10;
  for (std::int64_t* count : {&change.keyframes_put, &change.keyframes_removed, &change.points_put,
                              &change.points_removed, &change.cameras_put, &change.cameras_removed,
                              &change.sessions_put, &change.components_put, &change.components_removed}) {
    *count = ++number;
  }
  change.info_put = true;
  log.changes = {change};
  v1::ReadLogResponse told;
  ToProto(log, &told);
  const api::MapLog read = FromProto(OverTheWire(told));
  EXPECT_EQ(read.revision, 7u);
  ASSERT_EQ(read.changes.size(), 1u);
  EXPECT_TRUE(read.changes[0] == change);

  v1::ReadLogRequest request;
  EXPECT_EQ(FromProto(request)->max_count, map::kMaxLoggedChanges);
  request.set_max_count(std::numeric_limits<std::int32_t>::max());
  EXPECT_EQ(FromProto(request)->max_count, map::kMaxLoggedChanges);
  request.set_max_count(-1);
  EXPECT_EQ(FromProto(request).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(ConvertAdmin, ContentsOfExports) {
  for (const auto content : {api::ExportContent::kMap, api::ExportContent::kTrajectory, api::ExportContent::kPoints}) {
    EXPECT_EQ(*Read(Write(content)), content);
  }
  EXPECT_EQ(Read(v1::ExportMapRequest::CONTENT_UNSPECIFIED).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(ConvertAlignment, WhatIsNoRequest) {
  v1::AlignMapRequest message;
  EXPECT_EQ(FromProto(message).status().code(), absl::StatusCode::kInvalidArgument) << "by nothing";
  message.set_remove_anchor(false);
  EXPECT_EQ(FromProto(message).status().code(), absl::StatusCode::kInvalidArgument);
  message.set_remove_anchor(true);
  EXPECT_TRUE(FromProto(message).ok());
  message.mutable_anchor()->set_latitude_deg(60.0);
  EXPECT_EQ(FromProto(message).status().code(), absl::StatusCode::kInvalidArgument) << "without a rotation";
  message.mutable_anchor()->mutable_enu_from_world()->set_w(1.0);
  EXPECT_TRUE(FromProto(message).ok());
  message.mutable_anchor()->set_longitude_deg(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(FromProto(message).status().code(), absl::StatusCode::kInvalidArgument);
  message.mutable_poses()->add_poses();
  EXPECT_EQ(FromProto(message).status().code(), absl::StatusCode::kInvalidArgument) << "a pose without rotation";
  message.mutable_positions()->add_positions()->mutable_position()->set_height_m(1e9);
  EXPECT_EQ(FromProto(message).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(ConvertAlignment, KnownPlacesComeBackWhole) {
  api::KnownPlaces known;
  known.positions = {{PointId(3), Vector3d(1, 2, 3)}, {KeyframeId(4), Vector3d(4, 5, 6)}};
  known.distances = {{api::SeenAt{KeyframeId(5), Vector2d(6.5, 7.25)}, PointId(8), 9.5}};
  known.gravity = Vector3d(0, 9.8, 0.5);
  known.upright_cameras = true;
  api::AlignRequest request;
  request.by = known;
  v1::AlignMapRequest message;
  ToProto(request, &message);
  const auto back = FromProto(OverTheWire(message));
  ASSERT_TRUE(back.ok()) << back.status();
  const auto& read = std::get<api::KnownPlaces>(back->by);
  ASSERT_EQ(read.positions.size(), 2u);
  EXPECT_EQ(std::get<PointId>(read.positions[0].of), PointId(3));
  EXPECT_EQ(read.positions[0].world_m, Vector3d(1, 2, 3));
  EXPECT_EQ(std::get<KeyframeId>(read.positions[1].of), KeyframeId(4));
  ASSERT_EQ(read.distances.size(), 1u);
  const auto& seen = std::get<api::SeenAt>(read.distances[0].from);
  EXPECT_EQ(seen.keyframe, KeyframeId(5));
  EXPECT_EQ(seen.pixel, Vector2d(6.5, 7.25));
  EXPECT_EQ(std::get<PointId>(read.distances[0].to), PointId(8));
  EXPECT_EQ(read.distances[0].metres, 9.5);
  EXPECT_EQ(read.gravity, Vector3d(0, 9.8, 0.5));
  EXPECT_TRUE(read.upright_cameras);
  message.mutable_places()->mutable_positions(0)->clear_of();
  EXPECT_EQ(FromProto(message).status().code(), absl::StatusCode::kInvalidArgument) << "of nothing";
}

TEST(ConvertAlignment, AnswersComeBackWhole) {
  api::AlignAnswer answer;
  answer.revision = 12;
  answer.geo_anchor = map::GeoAnchor{1.0, 2.0, 3.0, Quaterniond::Identity()};
  answer.geo_anchor_changed = true;
  api::ComponentAlignment& found = answer.component.emplace();
  found.component = ComponentId(2);
  found.world_from_component = Sim3(ExpSO3(Vector3d(0.1, 0.0, 0.0)), Vector3d(1, 2, 3), 4.0);
  found.keyframes = 10;
  found.with_reference = 9;
  found.fitting = 8;
  found.misfits_s = {1.5};
  found.scale_sigma = 0.1;
  found.orientations.kind = OrientationKind::kBody;
  found.orientations.camera_from_body = Quaterniond(ExpSO3(Vector3d(0.0, 0.5, 0.0)));
  found.orientations_used = true;
  found.errors_m = {0.25, 0.5};
  found.moved_m = 0.0;
  found.others = {{ComponentId(1), 5, 4, true}};
  v1::AlignMapResponse message;
  ToProto(answer, &message);
  auto back = FromProto(OverTheWire(message));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->revision, 12u);
  EXPECT_TRUE(back->geo_anchor_changed);
  EXPECT_EQ(back->geo_anchor->height_m, 3.0);
  ASSERT_TRUE(back->component);
  EXPECT_EQ(back->component->world_from_component.scale(), 4.0);
  EXPECT_EQ(back->component->fitting, 8);
  EXPECT_THAT(back->component->misfits_s, testing::ElementsAre(1.5));
  EXPECT_EQ(back->component->orientations.kind, OrientationKind::kBody);
  EXPECT_EQ(back->component->orientations.camera_from_body.coeffs(), found.orientations.camera_from_body.coeffs());
  EXPECT_THAT(back->component->errors_m, testing::ElementsAre(0.25, 0.5));
  EXPECT_EQ(back->component->moved_m, 0.0);
  EXPECT_EQ(back->component->others[0].with_reference, 4);
  message.mutable_component()->clear_moved_m();
  EXPECT_FALSE(FromProto(message)->component->moved_m);
}

TEST(ConvertStatus, ComesBackWhole) {
  api::ServerStatus status;
  status.version = "1";
  status.uptime_s = 5.5;
  status.maps = {{"office", 7, 1000, true}};
  api::ActiveSession session;
  session.map = "office";
  session.source = "robot";
  session.waiting = true;
  session.running_s = 9.0;
  session.silent_s = 2.0;
  session.frames = 100;
  session.state = api::SessionState::kPoor;
  session.progress.revision = 6;
  status.sessions = {session};
  status.calls = {{"Maps.ListMaps", "ok", 3}};
  status.localized = {{"located", 2}};
  status.localize = {{0.1, 0.2}, {1, 2, 3}, 0.9};
  v1::GetStatusResponse message;
  ToProto(status, &message);
  const api::ServerStatus back = FromProto(OverTheWire(message));
  EXPECT_EQ(back.uptime_s, 5.5);
  EXPECT_EQ(back.maps[0].memory_bytes, 1000);
  EXPECT_TRUE(back.maps[0].writing);
  ASSERT_EQ(back.sessions.size(), 1u);
  EXPECT_EQ(back.sessions[0].source, "robot");
  EXPECT_TRUE(back.sessions[0].waiting);
  EXPECT_EQ(back.sessions[0].silent_s, 2.0);
  EXPECT_EQ(back.sessions[0].state, api::SessionState::kPoor);
  EXPECT_TRUE(back.sessions[0].progress == session.progress);
  EXPECT_EQ(back.calls[0].count, 3);
  EXPECT_EQ(back.localized[0].what, "located");
  EXPECT_EQ(back.localize.bounds_s, status.localize.bounds_s);
  EXPECT_EQ(back.localize.counts, status.localize.counts);
}

}  // namespace
}  // namespace cairn::wire

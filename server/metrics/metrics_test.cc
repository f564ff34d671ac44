#include "server/metrics/metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn::server {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(Metrics, CountsCallsOutcomesAndOpenMaps) {
  ServerState state;
  state.open_maps = {{"office", 7, 1000, true, 4096}, {"hall", 9, 500}};
  state.free_bytes = 12345;
  state.waiting = 3;
  state.followers = 2;
  state.sessions = 2;
  Metrics metrics([&] { return state; });
  metrics.OnCall("Maps.ListMaps", "ok", 0.0015);
  metrics.OnCall("Maps.ListMaps", "ok", 0.5);
  metrics.OnCall("Maps.ListMaps", "map_not_found", 0.0001);
  api::LocalizeAnswer answer;
  answer.stage = api::LocalizeStage::kPnp;
  metrics.OnLocalized(answer);
  answer.localized = true;
  metrics.OnLocalized(answer);
  metrics.OnSessionFrame("good", 0.0005);
  metrics.OnFramesDropped(3);
  api::TrackAnswer tracked;
  tracked.state = api::TrackState::kCarried;
  metrics.OnTracked(&tracked);
  metrics.OnTracked(nullptr);
  std::string text = metrics.Text();
  EXPECT_THAT(text, HasSubstr("cairn_calls_total{call=\"Maps.ListMaps\",reason=\"ok\"} 2\n"));
  EXPECT_THAT(text, HasSubstr("cairn_calls_total{call=\"Maps.ListMaps\",reason=\"map_not_found\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("cairn_call_seconds_bucket{call=\"Maps.ListMaps\",le=\"0.002\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("cairn_call_seconds_count{call=\"Maps.ListMaps\"} 2\n"));
  EXPECT_THAT(text, HasSubstr("cairn_localize_total{outcome=\"PnP inliers\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("cairn_localize_total{outcome=\"located\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("cairn_open_maps 2\n"));
  EXPECT_THAT(text, HasSubstr("cairn_open_maps_bytes 1500\n"));
  EXPECT_THAT(text, HasSubstr("cairn_localize_waiting 3\n"));
  EXPECT_THAT(text, HasSubstr("cairn_session_frames_dropped_total 3\n"));
  EXPECT_THAT(text, HasSubstr("cairn_map_log_bytes{map=\"office\"} 4096\n"));
  EXPECT_THAT(text, HasSubstr("cairn_maps_free_bytes 12345\n"));
  EXPECT_THAT(text, HasSubstr("cairn_followers 2\n"));
  EXPECT_THAT(text, HasSubstr("cairn_sessions{client=\"here\"} 2\n"));
  EXPECT_THAT(text, HasSubstr("cairn_track_frames_total{state=\"carried\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("cairn_track_frames_total{state=\"refused\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("cairn_session_frames_total{state=\"good\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("cairn_session_frame_seconds_bucket{le=\"0.001\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("cairn_map_revision{map=\"office\"} 7\n"));
  EXPECT_THAT(text, Not(HasSubstr("process_resident_memory_bytes 0")));
  state.open_maps.pop_back();
  text = metrics.Text();
  EXPECT_THAT(text, Not(HasSubstr("hall"))) << "it is not open any more";
  EXPECT_THAT(text, HasSubstr("cairn_open_maps 1\n"));
}

TEST(Metrics, TheSameAsAStatus) {
  ServerState state;
  state.open_maps = {{"hall", 9, 500}, {"office", 7, 1000, true}};
  state.waiting = 3;
  state.followers = 2;
  api::ActiveSession session;
  session.map = "office";
  state.active_sessions = {session};
  Metrics metrics([&] { return state; });
  metrics.OnCall("Maps.ListMaps", "ok", 0.5);
  metrics.OnCall("Localize.LocalizeImage", "ok", 0.015);
  metrics.OnCall("GeoPose", "ok", 0.016);
  metrics.OnCall("Localize.LocalizeImage", "ok", 100.0);
  metrics.OnCall("Localize.LocalizeImage", "invalid_argument", 0.0001);
  api::LocalizeAnswer answer;
  metrics.OnLocalized(answer);
  answer.localized = true;
  metrics.OnLocalized(answer);
  metrics.OnLocalized(answer);
  metrics.OnSessionFrame("good", 0.0005);
  metrics.OnTracked(nullptr);
  const api::ServerStatus status = metrics.Status();
  EXPECT_FALSE(status.version.empty());
  EXPECT_GT(status.resident_bytes, 0);
  EXPECT_EQ(status.images_waiting, 3);
  EXPECT_EQ(status.followers, 2);
  ASSERT_EQ(status.maps.size(), 2u);
  EXPECT_EQ(status.maps[1].revision, 7u);
  EXPECT_TRUE(status.maps[1].writing);
  ASSERT_EQ(status.sessions.size(), 1u);
  ASSERT_EQ(status.calls.size(), 4u);
  EXPECT_EQ(status.calls[0].call, "GeoPose");
  EXPECT_EQ(status.calls[1].call, "Localize.LocalizeImage");
  EXPECT_EQ(status.calls[1].reason, "invalid_argument");
  EXPECT_EQ(status.calls[2].count, 2);
  ASSERT_EQ(status.localized.size(), 2u);
  EXPECT_EQ(status.localized[0].what, "features");
  EXPECT_EQ(status.localized[0].count, 1);
  EXPECT_EQ(status.localized[1].what, "located");
  EXPECT_EQ(status.localized[1].count, 2);
  EXPECT_EQ(status.localize.total(), 3) << "whichever way they came in, but those that were refused";
  EXPECT_EQ(status.localize.counts.back(), 1) << "longer than the last bound";
  EXPECT_GT(status.localize.Quantile(0.5), 0.01);
  EXPECT_LE(status.localize.Quantile(0.5), 0.02);
  EXPECT_EQ(status.session_frame.total(), 1);
  EXPECT_EQ(status.tracking.total(), 0);
  ASSERT_EQ(status.tracked.size(), 1u);
  EXPECT_EQ(status.tracked[0].what, "refused");
}

}  // namespace
}  // namespace cairn::server

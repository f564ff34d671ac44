#include "server/metrics/metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn::server {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(Metrics, CountsCallsOutcomesAndOpenMaps) {
  ServerState state;
  state.open_maps = {{"office", 7, 1000}, {"hall", 9, 500}};
  state.waiting = 3;
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
  api::TrackAnswer tracked;
  tracked.state = api::TrackState::kCarried;
  metrics.OnTracked(&tracked);
  metrics.OnTracked(nullptr);
  std::string text = metrics.Text();
  EXPECT_THAT(text, HasSubstr("cairn_calls_total{call=\"Maps.ListMaps\",reason=\"ok\"} 2\n"));
  EXPECT_THAT(text, HasSubstr("cairn_calls_total{call=\"Maps.ListMaps\",reason=\"map_not_found\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("cairn_call_seconds_bucket{call=\"Maps.ListMaps\",le=\"0.002\"} 2\n"));
  EXPECT_THAT(text, HasSubstr("cairn_call_seconds_count{call=\"Maps.ListMaps\"} 3\n"));
  EXPECT_THAT(text, HasSubstr("cairn_localize_total{outcome=\"PnP inliers\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("cairn_localize_total{outcome=\"located\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("cairn_open_maps 2\n"));
  EXPECT_THAT(text, HasSubstr("cairn_open_maps_bytes 1500\n"));
  EXPECT_THAT(text, HasSubstr("cairn_localize_waiting 3\n"));
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

}  // namespace
}  // namespace cairn::server

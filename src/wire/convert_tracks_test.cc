#include "wire/convert_tracks.h"

#include <gtest/gtest.h>

namespace cairn::wire {
namespace {

TEST(ConvertTracks, AnswersLossesAndRefusals) {
  const SE3 pose(Quaterniond(0.5, 0.1, -0.3, 0.7), Vector3d(1.0 / 3.0, -2.0, 1e-9));
  api::TrackAnswer answer;
  answer.time_ns = 5;
  answer.state = api::TrackState::kCarried;
  answer.reason = "beyond the map";
  answer.map_from_camera = pose;
  answer.world_from_camera = pose.Inverse();
  answer.component = ComponentId(3);
  answer.world_per_map = 2.0;
  answer.world_is_metric = true;
  answer.covariance = Matrix6d::Random();
  answer.map_id = "ab";
  answer.revision = 9;
  answer.matched_ns = 4;
  answer.inliers = 30;
  answer.note = "the map was removed";
  answer.map_damaged = true;
  answer.track_ms = 0.5;
  v1::TrackAnswer message, sent;
  ToProto(answer, &message);
  ASSERT_TRUE(sent.ParseFromString(message.SerializeAsString()));
  auto back = FromProto(sent);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->time_ns, 5);
  EXPECT_EQ(back->state, api::TrackState::kCarried);
  EXPECT_EQ(back->reason, answer.reason);
  EXPECT_EQ(back->map_from_camera.translation(), pose.translation());
  EXPECT_EQ(back->world_from_camera.rotation().coeffs(), pose.Inverse().rotation().coeffs());
  EXPECT_EQ(back->component, ComponentId(3));
  EXPECT_EQ(back->world_per_map, 2.0);
  EXPECT_TRUE(back->world_is_metric);
  EXPECT_EQ(back->covariance, answer.covariance);
  EXPECT_EQ(back->map_id, "ab");
  EXPECT_EQ(back->revision, 9u);
  EXPECT_EQ(back->matched_ns, 4);
  EXPECT_EQ(back->inliers, 30);
  EXPECT_EQ(back->note, answer.note);
  EXPECT_TRUE(back->map_damaged);
  EXPECT_EQ(back->track_ms, 0.5);

  answer.state = api::TrackState::kLost;
  message.Clear();
  ToProto(answer, &message);
  EXPECT_FALSE(message.has_map_from_camera());
  back = FromProto(message);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->state, api::TrackState::kLost);
  message.set_error_reason("invalid_argument");
  message.set_error_message("older");
  EXPECT_EQ(FromProto(message).status(), absl::InvalidArgumentError("older"));
}

}  // namespace
}  // namespace cairn::wire

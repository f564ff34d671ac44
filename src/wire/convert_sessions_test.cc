#include "wire/convert_sessions.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "wire/testing_messages.h"

namespace cairn::wire {
namespace {

// Of a folder in Latin-1: protobuf would refuse all of the message.
TEST(ConvertSessions, NamesInAnyEncodingArrive) {
  api::SessionRequest request;
  request.policy = map::SessionPolicy::kCreate;
  request.camera = Camera::FromPinhole({640, 480, 525.0, 525.0, 319.5, 239.5});
  request.source =
      "k\xfc"
      "che";
  request.title =
      "k\xc3\xbc"
      "che";
  v1::StartSession message;
  ToProto(request, &message);
  const auto back = FromProto(OverTheWire(message));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->source,
            "k\xef\xbf\xbd"
            "che");
  EXPECT_EQ(back->title, request.title) << "UTF-8 as it is";
}

TEST(ConvertSessions, RequestsArriveAndNeedAPolicy) {
  api::SessionRequest request;
  request.map = "office";
  request.policy = map::SessionPolicy::kCreate;
  request.camera = Camera::FromPinhole({640, 480, 525.0, 525.0, 319.5, 239.5});
  request.camera_name = "left";
  request.source = "robot 7";
  request.title = "The office";
  request.first_ns = 77;
  request.least_revision = 12;
  request.map_id = "0123456789abcdef0123456789abcdef";
  v1::StartSession message;
  ToProto(request, &message);
  const auto back = FromProto(OverTheWire(message));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->map, "office");
  EXPECT_EQ(back->policy, request.policy);
  EXPECT_EQ(back->camera, request.camera);
  EXPECT_EQ(back->camera_name, "left");
  EXPECT_EQ(back->source, "robot 7");
  EXPECT_EQ(back->title, "The office");
  EXPECT_EQ(back->first_ns, 77);
  EXPECT_EQ(back->map_id, request.map_id);
  EXPECT_EQ(back->least_revision, 12u);
  message.clear_policy();
  EXPECT_EQ(FromProto(message).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(ConvertSessions, AnswersWithAndWithoutAPoseAndRefusals) {
  api::SessionAnswer answer;
  answer.time_ns = 5;
  answer.state = api::SessionState::kPoor;
  answer.map_from_camera = kPose;
  answer.component = ComponentId(3);
  answer.world_from_component = Sim3(kPose);
  v1::FrameAnswer message;
  ToProto(answer, &message);
  auto back = FromProto(OverTheWire(message));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->time_ns, 5);
  EXPECT_EQ(back->state, api::SessionState::kPoor);
  EXPECT_EQ(back->map_from_camera->translation(), kPose.translation());
  EXPECT_EQ(back->component, ComponentId(3));
  EXPECT_TRUE(back->world_from_component);
  answer.map_from_camera.reset();
  answer.reason = "too dark";
  message.Clear();
  ToProto(answer, &message);
  back = FromProto(OverTheWire(message));
  EXPECT_FALSE(back->map_from_camera);
  EXPECT_EQ(back->reason, "too dark");
  message.set_error_reason("invalid_argument");
  message.set_error_message("no image");
  EXPECT_EQ(FromProto(message).status(), absl::InvalidArgumentError("no image"));
}

TEST(ConvertSessions, ProgressAndSummary) {
  api::SessionProgress progress;
  progress.session = SessionId(2);
  progress.revision = 1ull << 40;
  progress.keyframes = 10;
  v1::SessionProgress message;
  ToProto(progress, &message);
  EXPECT_EQ(FromProto(OverTheWire(message)), progress);
  progress.durable_ns = 0;
  progress.component = ComponentId(4);
  progress.located_ns = -1;
  progress.located_component = ComponentId(1);
  progress.joined_ns = 9;
  message.Clear();
  ToProto(progress, &message);
  EXPECT_EQ(FromProto(OverTheWire(message)), progress);

  api::SessionSummary summary;
  summary.session = SessionId(2);
  summary.frames = 100;
  summary.frames_tracked = 90;
  summary.result = map::SessionResult::kLocated;
  summary.component = ComponentId(1);
  summary.poses = {{5, kPose}, {6, kPose.Inverse()}};
  v1::SessionSummary sent;
  ToProto(summary, &sent);
  const auto back = FromProto(OverTheWire(sent));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->frames_tracked, 90);
  EXPECT_EQ(back->result, summary.result);
  EXPECT_FALSE(back->world_from_component);
  ASSERT_EQ(back->poses.size(), 2u);
  EXPECT_EQ(back->poses[1].time_ns, 6);
  EXPECT_EQ(back->poses[0].map_from_camera.translation(), kPose.translation());
}

}  // namespace
}  // namespace cairn::wire

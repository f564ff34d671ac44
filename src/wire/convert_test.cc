#include "wire/convert.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "wire/testing_messages.h"

namespace cairn::wire {
namespace {

TEST(Convert, PosesArriveToTheBit) {
  v1::Pose message;
  ToProto(kPose, &message);
  const auto back = FromProto(OverTheWire(message));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->translation(), kPose.translation());
  EXPECT_EQ(back->rotation().coeffs(), kPose.rotation().coeffs());
}

TEST(Convert, PosesThatMakeNoSenseAreRefused) {
  v1::Pose message;
  EXPECT_FALSE(FromProto(message).ok()) << "no rotation";
  ToProto(kPose, &message);
  message.mutable_translation()->set_y(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(FromProto(message).status().code(), absl::StatusCode::kInvalidArgument);
  ToProto(kPose, &message);
  message.mutable_rotation()->set_w(std::numeric_limits<double>::quiet_NaN());
  EXPECT_FALSE(FromProto(message).ok());
  v1::Similarity similarity;
  ToProto(Sim3(kPose), &similarity);
  EXPECT_TRUE(FromProto(similarity).ok());
  similarity.set_scale(0.0);
  EXPECT_FALSE(FromProto(similarity).ok());
}

TEST(Convert, CamerasOfEveryModel) {
  const std::vector<Camera> cameras = {
      {CameraModel::kPinhole, 640, 480, 525.0, 526.0, 319.5, 239.5, {}},
      {CameraModel::kRadialTangential, 752, 480, 458.654, 457.296, 367.215, 248.375, {-0.28, 0.07, 2e-4, 2e-5}},
      {CameraModel::kKannalaBrandt, 512, 512, 190.0, 190.0, 254.9, 256.9, {0.003, 0.0007, -0.002, 0.0002}},
      {CameraModel::kFov, 1280, 1024, 535.0, 535.0, 639.5, 511.5, {0.93}}};
  for (const Camera& camera : cameras) {
    v1::Camera message;
    ToProto(camera, &message);
    const auto back = FromProto(OverTheWire(message));
    ASSERT_TRUE(back.ok()) << back.status();
    EXPECT_EQ(*back, camera);
  }
}

TEST(Convert, CamerasThatMakeNoSenseAreRefused) {
  EXPECT_EQ(FromProto(v1::Camera()).status().code(), absl::StatusCode::kInvalidArgument);
  v1::Camera message;
  ToProto(Camera::FromPinhole({640, 480, 525.0, 525.0, 319.5, 239.5}), &message);
  EXPECT_TRUE(FromProto(message).ok());
  v1::Camera bad = message;
  bad.set_model(static_cast<v1::Camera::Model>(17));
  EXPECT_FALSE(FromProto(bad).ok());
  bad = message;
  bad.set_width_px(-640);
  EXPECT_FALSE(FromProto(bad).ok());
  bad = message;
  bad.set_fx_px(std::numeric_limits<double>::infinity());
  EXPECT_FALSE(FromProto(bad).ok());
  bad = message;
  bad.add_distortion(0.1);
  EXPECT_FALSE(FromProto(bad).ok());
}

TEST(Convert, GrayImagesLoseTheGapsBetweenTheirRows) {
  cv::Mat image(4, 6, CV_8UC1);
  for (int y = 0; y < 4; ++y) {
    for (int x = 0; x < 6; ++x) image.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(10 * y + x);
  }
  v1::Image message;
  ToProto(image(cv::Rect(1, 1, 3, 2)), &message);
  EXPECT_EQ(message.gray(), std::string({11, 12, 13, 21, 22, 23}));
}

TEST(Convert, AnswersAndMisses) {
  api::LocalizeAnswer answer;
  answer.localized = true;
  answer.stage = api::LocalizeStage::kDone;
  answer.counts = {1, 2, 3, 4, 5, 6};
  answer.map_from_camera = kPose;
  answer.world_from_camera = kPose.Inverse();
  answer.component = ComponentId(3);
  answer.components = 4;
  answer.world_per_map = 2.5;
  answer.world_is_metric = true;
  answer.covariance = Matrix6d::Random();
  answer.map_id = "0123";
  answer.revision = 1ull << 60;
  answer.lens = api::LensUse::kOtherCalibration;
  answer.reference_keyframe = KeyframeId(77);
  answer.extract_ms = 1.5;
  answer.locate_ms = 2.5;
  v1::LocalizeImageResponse message;
  ToProto(answer, &message);
  auto back = FromProto(OverTheWire(message));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_TRUE(back->localized);
  EXPECT_EQ(back->stage, answer.stage);
  EXPECT_EQ(back->counts.features, 1);
  EXPECT_EQ(back->counts.inliers, 6);
  EXPECT_EQ(back->map_from_camera.translation(), kPose.translation());
  EXPECT_EQ(back->world_from_camera.rotation().coeffs(), kPose.Inverse().rotation().coeffs());
  EXPECT_EQ(back->component, answer.component);
  EXPECT_EQ(back->components, 4);
  EXPECT_EQ(back->world_per_map, 2.5);
  EXPECT_TRUE(back->world_is_metric);
  EXPECT_EQ(back->covariance, answer.covariance);
  EXPECT_EQ(back->map_id, "0123");
  EXPECT_EQ(back->revision, answer.revision);
  EXPECT_EQ(back->lens, answer.lens);
  EXPECT_EQ(back->reference_keyframe, answer.reference_keyframe);
  EXPECT_EQ(back->extract_ms + back->locate_ms, 4.0);

  answer.localized = false;
  answer.stage = api::LocalizeStage::kPnp;
  answer.reason = "no pose";
  message.Clear();
  ToProto(answer, &message);
  back = FromProto(OverTheWire(message));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_FALSE(back->localized);
  EXPECT_EQ(back->stage, api::LocalizeStage::kPnp);
  EXPECT_EQ(back->reason, "no pose");
}

TEST(Convert, DescriptionsOfMaps) {
  api::MapDescription description;
  description.summary.name = "office";
  description.summary.id = "ab";
  description.summary.revision = 9;
  description.summary.keyframes = 100;
  description.summary.file_bytes = 1ll << 40;
  description.summary.writing = true;
  description.cameras.push_back(
      {CameraId(1), "left", Camera::FromPinhole({640, 480, 525.0, 525.0, 319.5, 239.5}), true});
  description.components.push_back({ComponentId(1), SessionId(1), 100, Sim3(kPose), {}});
  description.components.push_back({ComponentId(2), SessionId(2), 0, std::nullopt, ComponentId(1)});
  map::Session session;
  session.id = SessionId(2);
  session.camera = CameraId(1);
  session.source = "visit";
  session.last_ns = 5;
  session.complete = true;
  session.policy = map::SessionPolicy::kExtend;
  session.result = map::SessionResult::kLocated;
  session.components = {ComponentId(1), ComponentId(2)};
  description.sessions = {session};
  v1::DescribeMapResponse message;
  ToProto(description, &message);
  const auto back = FromProto(OverTheWire(message));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->summary.name, "office");
  EXPECT_TRUE(back->summary.status.ok());
  EXPECT_EQ(back->summary.revision, 9u);
  EXPECT_EQ(back->summary.file_bytes, 1ll << 40);
  EXPECT_TRUE(back->summary.writing);
  EXPECT_FALSE(back->summary.open);
  EXPECT_EQ(back->cameras, description.cameras);
  EXPECT_EQ(back->sessions, description.sessions);
  ASSERT_EQ(back->components.size(), 2u);
  EXPECT_EQ(back->components[0].world_from_component->scale(), 1.0);
  EXPECT_FALSE(back->components[1].world_from_component);
  EXPECT_EQ(back->components[1].joined_into, ComponentId(1));
  EXPECT_FALSE(back->components[0].joined_into);

  api::MapSummary broken;
  broken.name = "broken";
  broken.status = absl::DataLossError("is damaged");
  v1::MapSummary line;
  ToProto(broken, &line);
  EXPECT_EQ(FromProto(line)->status.message(), "is damaged");
}

api::ImageFeatures SomeFeatures() {
  api::ImageFeatures features;
  features.pinhole = {640, 480, 500.0, 501.0, 320.0, 240.0};
  for (int i = 0; i < 100; ++i) {
    features.features.keypoints.push_back(
        {6.0f * static_cast<float>(i) + 0.25f, 4.0f * static_cast<float>(i), 0.01f, static_cast<std::uint8_t>(i % 8)});
    features.features.descriptors.push_back({static_cast<std::uint64_t>(i), 2, 3, 4});
  }
  return features;
}

TEST(Convert, FeaturesComeBackAsTheyWereAndOthersAreRefused) {
  const api::ImageFeatures features = SomeFeatures();
  v1::ImageFeatures message;
  ToProto(features, &message);
  const auto read = FromProto(message);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->features.descriptors, features.features.descriptors);
  EXPECT_EQ(read->features.keypoints.size(), features.features.keypoints.size());
  EXPECT_EQ(read->features.keypoints[7].x_px, features.features.keypoints[7].x_px);
  EXPECT_EQ(read->features.keypoints[7].octave, 7);
  EXPECT_EQ(read->pinhole, features.pinhole);
  EXPECT_EQ(read->orb, features.orb);
  const auto refused = [&](auto change) {
    v1::ImageFeatures changed = message;
    change(&changed);
    return FromProto(changed).status().code() == absl::StatusCode::kInvalidArgument;
  };
  EXPECT_TRUE(refused([](auto* m) { m->mutable_features()->set_count(101); }));
  EXPECT_TRUE(refused([](auto* m) { m->mutable_features()->set_count(4'000'000'000u); }));
  EXPECT_TRUE(refused([](auto* m) { m->mutable_features()->set_keypoint_layout(77); }));
  EXPECT_TRUE(refused([](auto* m) { m->mutable_features()->mutable_descriptors()->pop_back(); }));
  EXPECT_TRUE(refused([](auto* m) { m->mutable_features()->set_word_bytes(2); }));
  EXPECT_TRUE(refused([](auto* m) { m->mutable_orb()->set_num_levels(3); })) << "octaves that there are not";
  EXPECT_TRUE(refused([](auto* m) { m->mutable_orb()->set_scale_factor(0.5); }));
  EXPECT_TRUE(refused([](auto* m) { m->mutable_pinhole()->set_width_px(100); })) << "keypoints beyond the image";
  EXPECT_TRUE(refused([](auto* m) { m->mutable_pinhole()->set_fx_px(-1.0); }));
  EXPECT_TRUE(refused([](auto* m) { m->clear_pinhole(); }));
}

}  // namespace
}  // namespace cairn::wire

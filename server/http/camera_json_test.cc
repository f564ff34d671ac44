#include "server/http/camera_json.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn::server {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

TEST(CameraJson, PixelCentresMoveByAHalf) {
  const auto camera = CameraFromJson(R"({"model":"PINHOLE","params":[525,526,320,240]})");
  ASSERT_TRUE(camera.ok()) << camera.status();
  EXPECT_EQ(*camera, (Camera{CameraModel::kPinhole, 0, 0, 525.0, 526.0, 319.5, 239.5, {}}));
}

TEST(CameraJson, EveryModel) {
  const auto parse = [](const std::string& model, const std::string& params) {
    const auto camera =
        CameraFromJson("{\"model\":\"" + model + "\",\"params\":[" + params + "],\"width\":640,\"height\":480}");
    EXPECT_TRUE(camera.ok()) << camera.status();
    EXPECT_TRUE(camera->Validate().ok()) << camera->Validate();
    return *camera;
  };
  EXPECT_EQ(parse("SIMPLE_PINHOLE", "500,320,240").fy_px, 500.0);
  EXPECT_THAT(parse("SIMPLE_RADIAL", "500,320,240,0.1").distortion, ElementsAre(0.1, 0.0, 0.0, 0.0));
  EXPECT_THAT(parse("RADIAL", "500,320,240,0.1,0.2").distortion, ElementsAre(0.1, 0.2, 0.0, 0.0));
  EXPECT_THAT(parse("OPENCV", "500,501,320,240,0.1,0.2,0.3,0.4").distortion, ElementsAre(0.1, 0.2, 0.3, 0.4));
  EXPECT_EQ(parse("FULL_OPENCV", "500,501,320,240,1,2,3,4,5,6,7,8").distortion.size(), 8u);
  EXPECT_EQ(parse("OPENCV_FISHEYE", "500,501,320,240,0.1,0.2,0.3,0.4").model, CameraModel::kKannalaBrandt);
  const Camera fov = parse("FOV", "500,501,320,240,0.9");
  EXPECT_EQ(fov.model, CameraModel::kFov);
  EXPECT_EQ(fov.width_px, 640);
}

TEST(CameraJson, WhatMakesNoSenseIsRefused) {
  const auto refusal = [](const std::string& json) {
    const absl::Status status = CameraFromJson(json).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << json;
    return std::string(status.message());
  };
  for (const char* json : {"", "{", "[]", "3", "{}", "{\"model\":3}", "\xff"}) refusal(json);
  EXPECT_THAT(refusal(R"({"model":"EYE","params":[1,2,3]})"), HasSubstr("SIMPLE_PINHOLE, PINHOLE"));
  EXPECT_THAT(refusal(R"({"model":"PINHOLE","params":[1,2,3]})"), HasSubstr("4 numbers"));
  EXPECT_THAT(refusal(R"({"model":"PINHOLE"})"), HasSubstr("4 numbers"));
  EXPECT_THAT(refusal(R"({"model":"PINHOLE","params":[1,2,3,null]})"), HasSubstr("4 numbers"));
  EXPECT_THAT(refusal(R"({"model":"PINHOLE","params":[1,2,3,4],"widht":640})"), HasSubstr("widht"));
  EXPECT_THAT(refusal(R"({"model":"PINHOLE","params":[1,2,3,4],"width":-1})"), HasSubstr("width"));
  EXPECT_THAT(refusal(R"({"model":"PINHOLE","params":[1,2,3,4],"width":1e300})"), HasSubstr("width"));
}

}  // namespace
}  // namespace cairn::server

#include "geometry/lens_plausibility.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn {
namespace {

using ::testing::HasSubstr;

Camera Pinhole640(double fx, double fy, double cx, double cy) {
  return Camera::FromPinhole({640, 480, fx, fy, cx, cy});
}

std::string Refusal(const Camera& camera) { return std::string(camera.Validate().message()); }

TEST(CheckLens, WhatNoLensIsIsRefusedWithAGuess) {
  EXPECT_THAT(Refusal(Pinhole640(3.637, 3.638, 320, 240)), HasSubstr("millimetres"));
  EXPECT_THAT(Refusal(Pinhole640(50, 50, 320, 240)), HasSubstr("millimetres"));
  EXPECT_THAT(Refusal(Pinhole640(0.65625, 0.875, 0.5, 0.5)), HasSubstr("fx 420, fy 420, cx 319.5, cy 239.5"));
  EXPECT_THAT(Refusal(Pinhole640(420, 420, 0, 0)), HasSubstr("principal point"));
  EXPECT_THAT(Refusal(Pinhole640(420, 420, 639, 479)), HasSubstr("principal point"));
  EXPECT_THAT(Refusal(Pinhole640(420, 420, 0, 479)), HasSubstr("principal point"));
  EXPECT_THAT(Refusal(Pinhole640(900, 900, 640, 360)), HasSubstr("another image size"));
  EXPECT_THAT(Refusal(Pinhole640(420, 4.2, 319.5, 239.5)), HasSubstr("factor of 100"));
  EXPECT_THAT(Refusal(Pinhole640(42, 420, 319.5, 239.5)), HasSubstr("factor of 10"));
  EXPECT_THAT(Refusal(Pinhole640(42000, 42000, 319.5, 239.5)), HasSubstr("too long"));
}

TEST(CheckLens, WhatLensesAreIsNotRefused) {
  const std::vector<Camera> lenses = {
      Pinhole640(420, 420, 319.5, 239.5),
      Pinhole640(200, 200, 319.5, 239.5),                                 // 116 degrees
      Pinhole640(6000, 6000, 319.5, 239.5),                               // 6 degrees
      Pinhole640(420, 420, 400, 330),                                     // cropped
      Camera::FromPinhole({1241, 376, 718.856, 718.856, 607.19, 185.2}),  // KITTI
      Camera::FromPinhole({720, 288, 1600, 800, 359.5, 143.5}),           // a half picture
      {CameraModel::kKannalaBrandt, 512, 512, 190.9, 190.9, 254.9, 256.9, {0.003, 0.0007, -0.002, 0.0002}},  // TUM VI
      {CameraModel::kFov, 1280, 1024, 342, 342, 631, 512, {0.93}},
      {CameraModel::kRadialTangential, 752, 480, 458.6, 457.3, 367.2, 248.4, {-0.283, 0.074, 0.0002, 0.00002}}};
  for (const Camera& lens : lenses) EXPECT_TRUE(lens.Validate().ok()) << lens.Validate();
}

TEST(UnusualLens, IsTold) {
  EXPECT_EQ(UnusualLens(Pinhole640(420, 421, 310, 250)), "");
  EXPECT_THAT(UnusualLens(Pinhole640(420, 420, 160, 120)), HasSubstr("principal point"));
  EXPECT_THAT(UnusualLens(Pinhole640(420, 840, 320, 240)), HasSubstr("stretched"));
  EXPECT_THAT(UnusualLens(Pinhole640(420, 840, 160, 120)), HasSubstr(", and "));
}

}  // namespace
}  // namespace cairn

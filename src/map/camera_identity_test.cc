#include "map/camera_identity.h"

#include <gtest/gtest.h>

namespace cairn::map {
namespace {

Camera Lens() {
  Camera camera;
  camera.model = CameraModel::kRadialTangential;
  camera.width_px = 752;
  camera.height_px = 480;
  camera.fx_px = 458.7;
  camera.fy_px = 457.3;
  camera.cx_px = 367.2;
  camera.cy_px = 248.4;
  camera.distortion = {-0.28, 0.07, 0.0002, 0.00002};
  return camera;
}

// As whoever resizes images states it: `centres` says whether pixel centres or corners are counted from.
Camera Resized(const Camera& camera, double scale, bool centres) {
  Camera resized = camera;
  resized.width_px = static_cast<int>(scale * camera.width_px);
  resized.height_px = static_cast<int>(scale * camera.height_px);
  resized.fx_px *= scale;
  resized.fy_px *= scale;
  const double shift = centres ? 0.5 : 0.0;
  resized.cx_px = scale * (camera.cx_px + shift) - shift;
  resized.cy_px = scale * (camera.cy_px + shift) - shift;
  return resized;
}

TEST(CameraIdentity, ResizingKeepsTheLens) {
  const Camera lens = Lens();
  for (const double scale : {0.5, 0.25, 2.0, 3.0}) {
    for (const bool centres : {true, false}) {
      EXPECT_TRUE(SameLens(lens, Resized(lens, scale, centres))) << scale << centres;
      EXPECT_FALSE(SameCalibration(lens, Resized(lens, scale, centres)));
    }
  }
  EXPECT_TRUE(SameLens(lens, lens));
}

TEST(CameraIdentity, AnotherLensIsAnother) {
  const Camera lens = Lens();
  Camera other = Resized(lens, 2.0, true);
  other.fx_px *= 1.01;
  EXPECT_FALSE(SameLens(lens, other));
  other = Resized(lens, 2.0, true);
  other.distortion[0] = -0.27;
  EXPECT_FALSE(SameLens(lens, other));
  other = Resized(lens, 2.0, true);
  other.cx_px += 5.0;
  EXPECT_FALSE(SameLens(lens, other));
  other = Resized(lens, 2.0, true);
  other.height_px = 800;  // cropped
  EXPECT_FALSE(SameLens(lens, other));
}

}  // namespace
}  // namespace cairn::map

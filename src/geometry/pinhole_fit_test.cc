#include "geometry/pinhole_fit.h"

#include <gtest/gtest.h>

#include "base/random.h"

namespace cairn {
namespace {

constexpr Pinhole kCamera{640, 480, 520.0, 515.0, 319.5, 239.5};

std::vector<SeenPoint> Seen(int count, double noise_px, double wrong_share) {
  Random random(3);
  std::vector<SeenPoint> seen;
  while (static_cast<int>(seen.size()) < count) {
    const Eigen::Vector3d point(random.Uniform(-3, 3), random.Uniform(-3, 3), random.Uniform(1, 6));
    Eigen::Vector2d pixel = kCamera.Project(point);
    if (!kCamera.Contains(pixel)) continue;
    pixel += noise_px * Eigen::Vector2d(random.Normal(), random.Normal());
    if (random.Uniform() < wrong_share) pixel = {random.Uniform(0, 639), random.Uniform(0, 479)};
    seen.push_back({point, pixel});
  }
  return seen;
}

TEST(PinholeFit, FindsTheCamera) {
  const auto fit = FitPinhole(Seen(2000, 0.0, 0.0));
  ASSERT_TRUE(fit);
  EXPECT_NEAR(fit->camera.fx_px, kCamera.fx_px, 1e-8);
  EXPECT_NEAR(fit->camera.cy_px, kCamera.cy_px, 1e-8);
  EXPECT_EQ(fit->camera.width_px, 640);
  EXPECT_EQ(fit->camera.height_px, 480);
}

TEST(PinholeFit, BearsNoiseAndWrongMatches) {
  const auto fit = FitPinhole(Seen(2000, 1.0, 0.1));
  ASSERT_TRUE(fit);
  EXPECT_NEAR(fit->camera.fx_px, kCamera.fx_px, 0.5);
  EXPECT_NEAR(fit->camera.fy_px, kCamera.fy_px, 0.5);
  EXPECT_NEAR(fit->camera.cx_px, kCamera.cx_px, 0.3);
  EXPECT_LT(fit->median_error_px, 2.0);
}

TEST(PinholeFit, SaysWhatItCannotKnow) {
  EXPECT_FALSE(FitPinhole(Seen(10, 0.0, 0.0)));
  std::vector<SeenPoint> one_direction(100, SeenPoint{{0.1, 0.2, 1.0}, {371.5, 342.5}});
  EXPECT_FALSE(FitPinhole(one_direction));
  std::vector<SeenPoint> mirrored = Seen(200, 0.0, 0.0);
  for (SeenPoint& point : mirrored) point.pixel.x() = 639 - point.pixel.x();
  EXPECT_FALSE(FitPinhole(mirrored));
}

}  // namespace
}  // namespace cairn

#include "synth/arm.h"

#include <cmath>
#include <numbers>

#include "base/random.h"
#include "synth/world_builder.h"

namespace cairn::synth {
namespace {

constexpr double kDistance_m = 0.7;  // from the camera
constexpr double kLength_m = 0.75;   // of what stands into the view
constexpr double kBelow_m = 0.3;     // its end, under the lower edge of the view

}  // namespace

absl::StatusOr<Arm> Arm::Create(const SE3& world_from_rest, double view_share, std::uint64_t seed, const Camera& camera,
                                const Effects& effects) {
  if (!(view_share > 0.0 && view_share <= 0.6)) {
    return absl::InvalidArgumentError("arm: the share of the view must be in (0, 0.6]");
  }
  Random random(Derive(seed, 5000));
  Arm arm;
  arm.world_from_rest_ = world_from_rest;
  arm.phase_rad_ = random.Uniform(0.0, 2.0 * std::numbers::pi);
  const double view_m2 = kDistance_m * camera.width_px / camera.fx_px * kDistance_m * camera.height_px / camera.fy_px;
  const double half_m = 0.5 * view_share * view_m2 / kLength_m;
  WorldOptions options;
  options.seed = seed;
  options.texels_per_m = 600.0;
  WorldBuilder builder(options);
  builder.AddPanel(Place{}, {-half_m, half_m, -0.04, 0.04, 0.0, kBelow_m + kLength_m}, Material::kWallpaper,
                   Material::kFabric, random.Next());
  arm.world_ = std::make_unique<World>(builder.Finish());
  CAIRN_ASSIGN_OR_RETURN(Renderer renderer, Renderer::Create(*arm.world_, camera, effects));
  arm.renderer_ = std::make_unique<Renderer>(std::move(renderer));
  return arm;
}

SE3 Arm::WorldFromArm(double time_s) const {
  const auto wave = [&](double hz, double phase) {
    return std::sin(2.0 * std::numbers::pi * hz * time_s + phase + phase_rad_);
  };
  // Its length is up in the image: -y of the camera; its front faces the camera.
  Matrix3d upright;
  upright << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  const double bottom_m = 0.4;  // of the view at that distance, about
  const Vector3d end(0.10 + 0.10 * wave(0.4, 0.0), bottom_m + kBelow_m - 0.03 + 0.06 * wave(0.55, 1.0),
                     kDistance_m + 0.05 * wave(0.3, 2.0));
  const SE3 rest_from_arm(
      Quaterniond(ExpSO3(Vector3d(0.0, 0.0, -0.15 + 0.22 * wave(0.35, 0.5))) * Quaterniond(upright)), end);
  return world_from_rest_ * rest_from_arm;
}

void Arm::DrawInto(const Shot& shot, cv::Mat* image) const {
  Shot seen = shot;
  seen.world_from_camera = [&](double time_s) {
    return WorldFromArm(time_s).Inverse() * shot.world_from_camera(time_s);
  };
  const cv::Mat arm = renderer_->Render(seen);
  arm.copyTo(*image, renderer_->Depth(seen.world_from_camera(shot.time_s)) > 0.0);
}

void Arm::DrawIntoDepth(const SE3& world_from_camera, double time_s, cv::Mat* depth) const {
  const cv::Mat arm = renderer_->Depth(WorldFromArm(time_s).Inverse() * world_from_camera);
  arm.copyTo(*depth, arm > 0.0);
}

}  // namespace cairn::synth

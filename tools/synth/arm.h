// Something that moves before the camera: a textured limb that reaches into the view from below and works there, near
// the camera and never still. It has a renderer of its own, which sees it from where the camera is relative to it; what
// it covers hides the world. Its edges are those of the middle of the exposure.
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>

#include "base/status.h"
#include "geometry/se3.h"
#include "synth/render.h"
#include "synth/world.h"

namespace cairn::synth {

class Arm {
 public:
  // Before a camera at `world_from_rest`, covering about `view_share` of its view.
  static absl::StatusOr<Arm> Create(const SE3& world_from_rest, double view_share, std::uint64_t seed,
                                    const Camera& camera, const Effects& effects);

  SE3 WorldFromArm(double time_s) const;
  // Puts it into an image, or a depth image (render.h), of that shot.
  void DrawInto(const Shot& shot, cv::Mat* image) const;
  void DrawIntoDepth(const SE3& world_from_camera, double time_s, cv::Mat* depth) const;

 private:
  Arm() = default;

  SE3 world_from_rest_;
  double phase_rad_ = 0.0;
  std::unique_ptr<World> world_;  // the renderer keeps its address
  std::unique_ptr<Renderer> renderer_;
};

}  // namespace cairn::synth

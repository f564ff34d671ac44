// Photographs of a world. For each pixel a ray from any camera model of geometry/camera.h is cast against the few quads
// that a tile of pixels can see; textures are filtered to the pixel's footprint, and pixels at the edges of surfaces
// take nine rays. From the light that arrives the image is
//   I = round( 255 G( irradiance * exposure * V(x) ) + noise ),  G(e) = min(e, 1)^(1 / gamma)
// as in Engel, Usenko, Cremers, "A photometrically calibrated benchmark for monocular visual odometry" (2016), Eq. 1.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <opencv2/core.hpp>
#include <vector>

#include "base/status.h"
#include "geometry/camera.h"
#include "geometry/se3.h"
#include "synth/world.h"

namespace cairn::synth {

struct Effects {
  // 1: the sensor is linear.
  double gamma = 1.0;
  // Light lost in the corners of the image, in [0, 0.9].
  double vignette = 0.0;
  // Standard deviation of the noise in gray values, at full and at no light (photon noise grows with the root of the
  // light).
  double noise_dark = 0.0;
  double noise_bright = 0.0;
  // Blur of motion during the exposure: at most this many images are averaged, as many as the motion in pixels asks
  // for. 1: none.
  int max_blur_samples = 1;
  // From the first to the last row; each image is of the time of its middle row. 0: global shutter.
  double rolling_shutter_s = 0.0;
  // Gray value, before gamma, of a white surface in full light at relative exposure 1.
  double white_level = 290.0;

  absl::Status Validate() const;
};

// One photograph: where the camera is at a time in seconds, for the time of the exposure and of reading out.
struct Shot {
  std::function<SE3(double)> world_from_camera;
  double time_s = 0.0;             // middle of the exposure of the middle row
  double exposure_s = 0.0;         // for motion blur; 0: none
  double relative_exposure = 1.0;  // multiplies the light
  std::uint64_t noise_seed = 0;    // of this frame
};

class Renderer {
 public:
  // Keeps a reference to `world`. InvalidArgument for a bad camera or effects.
  static absl::StatusOr<Renderer> Create(const World& world, const Camera& camera, const Effects& effects);

  // CV_8UC1. Thread-safe.
  cv::Mat Render(const Shot& shot) const;
  // A still photograph.
  cv::Mat Render(const SE3& world_from_camera, std::uint64_t noise_seed = 0) const;
  // CV_32FC1, z in the camera frame in metres at each pixel's centre; 0 where there is nothing.
  cv::Mat Depth(const SE3& world_from_camera) const;

  const Camera& camera() const { return camera_; }
  const Effects& effects() const { return effects_; }
  // The factor of the lens in (0, 1], CV_32FC1 of the image's size.
  const cv::Mat& vignette() const { return vignette_; }
  // Inverse response: the light, in [0, 255], for each of the 256 gray values.
  std::array<double, 256> InverseResponse() const;

 private:
  static constexpr int kTile = 8;   // pixels each way
  static constexpr int kBlock = 4;  // tiles each way; what a block cannot see its tiles need not try

  // A quad that faces the camera, in the camera frame.
  struct Seen {
    Eigen::Vector3f normal, u, v;
    float height = 0.0f;  // of the quad's plane over the camera along its normal: negative
    float u0 = 0.0f;      // the texture's first corner less the camera, along u and v, in metres
    float v0 = 0.0f;
    float size_u = 0.0f;
    float size_v = 0.0f;
    std::array<Eigen::Vector3f, 4> corners;
    int quad = 0;
  };
  // Rows of tiles that are taken from one pose.
  struct Strip {
    int first_tile_row = 0;
    int end_tile_row = 0;
    std::vector<Seen> seen;
    std::vector<int> seen_of_quad;  // -1: not seen
  };
  struct Frame {
    std::vector<Strip> strips;
    std::vector<int> quad;        // per pixel, -1: nothing
    std::vector<float> distance;  // per pixel, along the unit ray
  };
  using Planes = std::array<Eigen::Vector3f, 4>;  // normals of planes through the camera, pointing inwards

  Renderer(const World& world, const Camera& camera, const Effects& effects)
      : world_(&world), camera_(camera), effects_(effects) {}
  void BuildRays();
  void BuildTables();
  Planes PlanesAround(int x0, int y0, int x1, int y1) const;
  Eigen::Vector3f Ray(int x, int y) const;

  Strip MakeStrip(const SE3& world_from_camera, int first_tile_row, int end_tile_row) const;
  Frame Cast(const std::function<SE3(double)>& world_from_camera, double time_s) const;
  void CastStrip(const Strip& strip, Frame& frame) const;
  void CastTile(const std::vector<Seen>& seen, const std::vector<int>& candidates, int x0, int y0, Frame& frame) const;
  float Shade(const Seen& seen, const Eigen::Vector3f& ray, const Eigen::Vector3f& ray_dx,
              const Eigen::Vector3f& ray_dy) const;
  float ShadeEdge(const Frame& frame, const Strip& strip, int x, int y, const Eigen::Vector3f& ray_dx,
                  const Eigen::Vector3f& ray_dy) const;
  void AddLight(const Frame& frame, std::vector<float>& light) const;
  int BlurSamples(const Shot& shot) const;
  cv::Mat Develop(const std::vector<float>& light, float gain, std::uint64_t noise_seed) const;

  const World* world_;
  Camera camera_;
  Effects effects_;
  std::vector<Eigen::Vector3f> rays_;  // unit directions in the camera frame, row by row; zero: the lens images nothing
  std::vector<float> ray_x_, ray_y_, ray_z_;  // the same, apart
  std::vector<Planes> tile_planes_, block_planes_;
  int tiles_x_ = 0, tiles_y_ = 0, blocks_x_ = 0, blocks_y_ = 0;
  cv::Mat vignette_;
  std::vector<float> response_;
};

}  // namespace cairn::synth

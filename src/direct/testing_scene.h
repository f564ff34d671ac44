// A small world for the tests of this folder: textured planes, ray-cast without noise.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "direct/packet.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"

namespace cairn::direct::testing {

// Smooth noise in [0, 1]: bicubic fade between hashed lattice values.
inline double ValueNoise(double x, double y, std::uint32_t seed) {
  const auto hash = [seed](int i, int j) {
    std::uint32_t h =
        seed * 0x9E3779B9u + static_cast<std::uint32_t>(i) * 0x85EBCA6Bu + static_cast<std::uint32_t>(j) * 0xC2B2AE35u;
    h ^= h >> 15, h *= 0x2C1B3C6Du, h ^= h >> 12, h *= 0x297A2D39u, h ^= h >> 15;
    return static_cast<double>(h) / 4294967296.0;
  };
  const int i = static_cast<int>(std::floor(x)), j = static_cast<int>(std::floor(y));
  const auto fade = [](double t) { return t * t * t * (t * (6.0 * t - 15.0) + 10.0); };
  const double u = fade(x - i), v = fade(y - j);
  return (1 - v) * ((1 - u) * hash(i, j) + u * hash(i + 1, j)) +
         v * ((1 - u) * hash(i, j + 1) + u * hash(i + 1, j + 1));
}

struct Plane {
  Vector3d origin, u, v;  // u, v orthonormal
  double half_u, half_v;  // extent
};

class Scene {
 public:
  // Of everything behind z = 2 m, what is less than `blank_half_m` off the x axis' origin has no texture.
  explicit Scene(double blank_half_m = 0.0) : blank_half_m_(blank_half_m) {
    const Vector3d x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
    planes_.push_back({Vector3d(0, 0, 4), x, y, 20, 20});                               // back wall
    planes_.push_back({Vector3d(0, 1.2, 0), x, z, 20, 20});                             // floor
    planes_.push_back({Vector3d(-2.2, 0, 0), z, y, 20, 20});                            // left wall
    planes_.push_back({Vector3d(0.9, 0.1, 2.6), Vector3d(0.8, 0, -0.6), y, 0.7, 0.6});  // slanted board
    planes_.push_back({Vector3d(-0.6, -0.5, 2.0), x, Vector3d(0, 0.8, 0.6), 0.35, 0.3});
  }

  explicit Scene(std::vector<Plane> planes) : planes_(std::move(planes)) {}

  double Depth(const Pinhole& camera, const SE3& world_from_camera, const Vector2d& pixel) const {
    double t;
    Intensity(camera, world_from_camera, pixel, &t);
    return t;
  }

  Frame Render(const Pinhole& camera, const SE3& world_from_camera, std::int64_t index, double gain = 1.0) const {
    Frame frame;
    frame.index = index;
    frame.time_ns = index * 33'333'333;
    frame.image.create(camera.height_px, camera.width_px, CV_8UC1);
    for (int y = 0; y < camera.height_px; ++y) {
      for (int x = 0; x < camera.width_px; ++x) {
        double depth;
        const double value = gain * Intensity(camera, world_from_camera, Vector2d(x, y), &depth);
        frame.image.at<unsigned char>(y, x) = static_cast<unsigned char>(std::clamp(value + 0.5, 0.0, 255.0));
      }
    }
    return frame;
  }

 private:
  double Intensity(const Pinhole& camera, const SE3& world_from_camera, const Vector2d& pixel, double* depth) const {
    const Vector3d ray = world_from_camera.rotation() * camera.Unproject(pixel);
    const Vector3d& centre = world_from_camera.translation();
    double best = 1e9, value = 0.0;
    for (std::size_t k = 0; k < planes_.size(); ++k) {
      const Plane& plane = planes_[k];
      const Vector3d normal = plane.u.cross(plane.v);
      const double along = ray.dot(normal);
      if (std::abs(along) < 1e-9) continue;
      const double t = (plane.origin - centre).dot(normal) / along;
      if (t < 0.1 || t > best) continue;
      const Vector3d hit = centre + t * ray - plane.origin;
      const double u = hit.dot(plane.u), v = hit.dot(plane.v);
      if (std::abs(u) > plane.half_u || std::abs(v) > plane.half_v) continue;
      best = t;
      const auto seed = static_cast<std::uint32_t>(k + 1);
      if (std::abs(hit.x() + plane.origin.x()) < blank_half_m_ && hit.z() + plane.origin.z() > 2.0) {
        value = 150.0;
        continue;
      }
      value = 20.0 + 120.0 * ValueNoise(4.0 * u, 4.0 * v, seed) + 80.0 * ValueNoise(11.0 * u, 11.0 * v, seed + 77);
    }
    *depth = best;
    return value;
  }

  std::vector<Plane> planes_;
  double blank_half_m_ = 0.0;
};

inline Pinhole TestCamera() { return {384, 288, 300.0, 300.0, 191.5, 143.5}; }

// A handheld sway: sideways and forward with some rotation. `t` in frames.
inline SE3 SwayPose(double t) {
  const Vector3d position(0.012 * t, 0.05 * std::sin(0.08 * t), 0.004 * t);
  const Vector3d turn(0.03 * std::sin(0.07 * t), -0.0015 * t, 0.02 * std::sin(0.05 * t));
  return SE3(ExpSO3(turn), position);
}

}  // namespace cairn::direct::testing

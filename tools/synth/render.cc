#include "synth/render.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/random.h"

namespace cairn::synth {
namespace {

constexpr int kResponseSteps = 1 << 16;
constexpr float kNothing = 0.02f;  // light where no surface is
constexpr float kOverlap = 2e-4f;  // metres by which quads reach over their borders, so that rounding leaves no gaps

bool Outside(const std::array<Eigen::Vector3f, 4>& planes, const std::array<Eigen::Vector3f, 4>& corners) {
  for (const Eigen::Vector3f& plane : planes) {
    if (plane.dot(corners[0]) < 0.0f && plane.dot(corners[1]) < 0.0f && plane.dot(corners[2]) < 0.0f &&
        plane.dot(corners[3]) < 0.0f) {
      return true;
    }
  }
  return false;
}

}  // namespace

absl::Status Effects::Validate() const {
  const auto bad = [](const std::string& what) { return absl::InvalidArgumentError("effects: " + what); };
  if (!(gamma >= 0.2 && gamma <= 5.0)) return bad("gamma must be in [0.2, 5]");
  if (!(vignette >= 0.0 && vignette <= 0.9)) return bad("vignette must be in [0, 0.9]");
  if (!(noise_dark >= 0.0 && noise_dark <= 100.0) || !(noise_bright >= 0.0 && noise_bright <= 100.0)) {
    return bad("noise must be in [0, 100] gray values");
  }
  if (max_blur_samples < 1 || max_blur_samples > 64) return bad("max_blur_samples must be in [1, 64]");
  if (!(rolling_shutter_s >= 0.0 && rolling_shutter_s <= 1.0)) return bad("rolling_shutter_s must be in [0, 1]");
  if (!(white_level > 0.0 && white_level <= 1000.0)) return bad("white_level must be in (0, 1000]");
  return absl::OkStatus();
}

absl::StatusOr<Renderer> Renderer::Create(const World& world, const Camera& camera, const Effects& effects) {
  CAIRN_RETURN_IF_ERROR(camera.Validate());
  CAIRN_RETURN_IF_ERROR(effects.Validate());
  if (camera.width_px < 16 || camera.height_px < 16) {
    return absl::InvalidArgumentError("a virtual camera needs at least 16x16 pixels");
  }
  Renderer renderer(world, camera, effects);
  renderer.BuildRays();
  renderer.BuildTables();
  return renderer;
}

void Renderer::BuildRays() {
  const int w = camera_.width_px, h = camera_.height_px;
  rays_.resize(static_cast<std::size_t>(w) * static_cast<std::size_t>(h), Eigen::Vector3f::Zero());
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      if (const auto ray = camera_.Unproject({static_cast<double>(x), static_cast<double>(y)})) {
        rays_[static_cast<std::size_t>(y) * static_cast<std::size_t>(w) + static_cast<std::size_t>(x)] =
            ray->cast<float>();
      }
    }
  }
  for (const Eigen::Vector3f& ray : rays_) {
    ray_x_.push_back(ray.x());
    ray_y_.push_back(ray.y());
    ray_z_.push_back(ray.z());
  }
  tiles_x_ = (w + kTile - 1) / kTile;
  tiles_y_ = (h + kTile - 1) / kTile;
  blocks_x_ = (tiles_x_ + kBlock - 1) / kBlock;
  blocks_y_ = (tiles_y_ + kBlock - 1) / kBlock;
  const auto planes = [&](int columns, int rows, int size) {
    std::vector<Planes> all;
    for (int y = 0; y < rows; ++y) {
      for (int x = 0; x < columns; ++x) {
        all.push_back(
            PlanesAround(x * size, y * size, std::min((x + 1) * size, w) - 1, std::min((y + 1) * size, h) - 1));
      }
    }
    return all;
  };
  tile_planes_ = planes(tiles_x_, tiles_y_, kTile);
  block_planes_ = planes(blocks_x_, blocks_y_, kTile * kBlock);
}

Eigen::Vector3f Renderer::Ray(int x, int y) const {
  return rays_[static_cast<std::size_t>(y) * static_cast<std::size_t>(camera_.width_px) + static_cast<std::size_t>(x)];
}

// Through the corner rays moved out by a pixel, which is more than distortion bends the line between two of them.
Renderer::Planes Renderer::PlanesAround(int x0, int y0, int x1, int y1) const {
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      if (Ray(x, y).isZero())
        return {Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero()};
    }
  }
  const auto corner = [&](int x, int y, int inner_x, int inner_y) {
    return Eigen::Vector3f(Ray(x, y) + (Ray(x, y) - Ray(inner_x, y)) + (Ray(x, y) - Ray(x, inner_y)));
  };
  const int xi = std::min(x0 + 1, x1), xj = std::max(x1 - 1, x0), yi = std::min(y0 + 1, y1), yj = std::max(y1 - 1, y0);
  const std::array<Eigen::Vector3f, 4> c = {corner(x0, y0, xi, yi), corner(x1, y0, xj, yi), corner(x1, y1, xj, yj),
                                            corner(x0, y1, xi, yj)};
  const Eigen::Vector3f center = c[0] + c[1] + c[2] + c[3];
  Planes planes;
  for (std::size_t k = 0; k < 4; ++k) {
    planes[k] = c[k].cross(c[(k + 1) % 4]);
    if (planes[k].dot(center) < 0.0f) planes[k] = -planes[k];
    // A tile one pixel wide has no such corner; it then sees every way.
    if (x0 == x1 || y0 == y1) planes[k].setZero();
  }
  return planes;
}

void Renderer::BuildTables() {
  const int w = camera_.width_px, h = camera_.height_px;
  vignette_.create(h, w, CV_32FC1);
  const double cx = camera_.cx_px, cy = camera_.cy_px;
  const double reach = std::hypot(std::max(cx, w - 1 - cx), std::max(cy, h - 1 - cy));
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      const double r2 = (std::pow(x - cx, 2) + std::pow(y - cy, 2)) / (reach * reach);
      vignette_.at<float>(y, x) = static_cast<float>(1.0 - effects_.vignette * (0.6 * r2 + 0.4 * r2 * r2));
    }
  }
  response_.resize(kResponseSteps);
  for (int i = 0; i < kResponseSteps; ++i) {
    response_[static_cast<std::size_t>(i)] =
        static_cast<float>(255.0 * std::pow(i / (kResponseSteps - 1.0), 1.0 / effects_.gamma));
  }
}

std::array<double, 256> Renderer::InverseResponse() const {
  std::array<double, 256> inverse{};
  for (std::size_t i = 0; i < 256; ++i) inverse[i] = 255.0 * std::pow(static_cast<double>(i) / 255.0, effects_.gamma);
  return inverse;
}

Renderer::Strip Renderer::MakeStrip(const SE3& world_from_camera, int first_tile_row, int end_tile_row) const {
  Strip strip;
  strip.first_tile_row = first_tile_row;
  strip.end_tile_row = end_tile_row;
  const std::vector<Quad>& quads = world_->quads();
  strip.seen_of_quad.assign(quads.size(), -1);
  const Eigen::Matrix3f camera_from_world = world_from_camera.RotationMatrix().transpose().cast<float>();
  const Eigen::Vector3f center = world_from_camera.translation().cast<float>();
  for (std::size_t i = 0; i < quads.size(); ++i) {
    const Quad& quad = quads[i];
    const Eigen::Vector3f offset = quad.corner - center;
    const float height = quad.normal.dot(offset);
    if (height > -1e-4f) continue;
    Seen seen;
    seen.normal = camera_from_world * quad.normal;
    seen.u = camera_from_world * quad.u;
    seen.v = camera_from_world * quad.v;
    seen.height = height;
    seen.u0 = quad.u.dot(offset);
    seen.v0 = quad.v.dot(offset);
    seen.size_u = quad.size_u_m;
    seen.size_v = quad.size_v_m;
    const Eigen::Vector3f corner = camera_from_world * offset;
    seen.corners = {corner, corner + quad.size_u_m * seen.u, corner + quad.size_v_m * seen.v,
                    corner + quad.size_u_m * seen.u + quad.size_v_m * seen.v};
    seen.quad = static_cast<int>(i);
    strip.seen_of_quad[i] = static_cast<int>(strip.seen.size());
    strip.seen.push_back(seen);
  }
  return strip;
}

Renderer::Frame Renderer::Cast(const std::function<SE3(double)>& world_from_camera, double time_s) const {
  Frame frame;
  frame.quad.assign(rays_.size(), -1);
  frame.distance.assign(rays_.size(), 0.0f);
  if (effects_.rolling_shutter_s > 0.0) {
    const double middle = 0.5 * (camera_.height_px - 1);
    for (int row = 0; row < tiles_y_; ++row) {
      const double y = row * kTile + 0.5 * (kTile - 1);
      const double late_s = (y - middle) / std::max(1.0, camera_.height_px - 1.0) * effects_.rolling_shutter_s;
      frame.strips.push_back(MakeStrip(world_from_camera(time_s + late_s), row, row + 1));
    }
  } else {
    frame.strips.push_back(MakeStrip(world_from_camera(time_s), 0, tiles_y_));
  }
  for (const Strip& strip : frame.strips) CastStrip(strip, frame);
  return frame;
}

void Renderer::CastStrip(const Strip& strip, Frame& frame) const {
  std::vector<int> in_block, in_tile;
  for (int by = strip.first_tile_row / kBlock; by * kBlock < strip.end_tile_row; ++by) {
    for (int bx = 0; bx < blocks_x_; ++bx) {
      const Planes& block = block_planes_[static_cast<std::size_t>(by * blocks_x_ + bx)];
      in_block.clear();
      for (std::size_t i = 0; i < strip.seen.size(); ++i) {
        if (!Outside(block, strip.seen[i].corners)) in_block.push_back(static_cast<int>(i));
      }
      const int first = std::max(by * kBlock, strip.first_tile_row);
      const int end = std::min((by + 1) * kBlock, strip.end_tile_row);
      for (int ty = first; ty < end; ++ty) {
        for (int tx = bx * kBlock; tx < std::min((bx + 1) * kBlock, tiles_x_); ++tx) {
          const Planes& tile = tile_planes_[static_cast<std::size_t>(ty * tiles_x_ + tx)];
          in_tile.clear();
          for (const int i : in_block) {
            if (!Outside(tile, strip.seen[static_cast<std::size_t>(i)].corners)) in_tile.push_back(i);
          }
          CastTile(strip.seen, in_tile, tx * kTile, ty * kTile, frame);
        }
      }
    }
  }
}

void Renderer::CastTile(const std::vector<Seen>& seen, const std::vector<int>& candidates, int x0, int y0,
                        Frame& frame) const {
  constexpr int kPixels = kTile * kTile;
  alignas(32) float dx[kPixels] = {}, dy[kPixels] = {}, dz[kPixels] = {}, best[kPixels];
  alignas(32) int id[kPixels];
  const int columns = std::min(kTile, camera_.width_px - x0), rows = std::min(kTile, camera_.height_px - y0);
  const auto index = [&](int row) {
    return static_cast<std::size_t>(y0 + row) * static_cast<std::size_t>(camera_.width_px) +
           static_cast<std::size_t>(x0);
  };
  for (int r = 0; r < rows; ++r) {
    std::copy_n(&ray_x_[index(r)], columns, dx + r * kTile);
    std::copy_n(&ray_y_[index(r)], columns, dy + r * kTile);
    std::copy_n(&ray_z_[index(r)], columns, dz + r * kTile);
  }
  std::fill_n(best, kPixels, std::numeric_limits<float>::max());
  std::fill_n(id, kPixels, -1);
  for (const int candidate : candidates) {
    const Seen& s = seen[static_cast<std::size_t>(candidate)];
    const float nx = s.normal.x(), ny = s.normal.y(), nz = s.normal.z();
    const float ux = s.u.x(), uy = s.u.y(), uz = s.u.z(), vx = s.v.x(), vy = s.v.y(), vz = s.v.z();
    const float height = s.height, u0 = s.u0 - kOverlap, v0 = s.v0 - kOverlap;
    const float size_u = s.size_u + 2.0f * kOverlap, size_v = s.size_v + 2.0f * kOverlap;
    const int quad = s.quad;
    for (int i = 0; i < kPixels; ++i) {
      const float facing = nx * dx[i] + ny * dy[i] + nz * dz[i];
      const float t = height / facing;
      const float u = t * (ux * dx[i] + uy * dy[i] + uz * dz[i]) - u0;
      const float v = t * (vx * dx[i] + vy * dy[i] + vz * dz[i]) - v0;
      const bool hit = (facing < 0.0f) & (t < best[i]) & (u >= 0.0f) & (v >= 0.0f) & (u <= size_u) & (v <= size_v);
      best[i] = hit ? t : best[i];
      id[i] = hit ? quad : id[i];
    }
  }
  for (int r = 0; r < rows; ++r) {
    std::copy_n(id + r * kTile, columns, &frame.quad[index(r)]);
    std::copy_n(best + r * kTile, columns, &frame.distance[index(r)]);
  }
}

float Renderer::Shade(const Seen& seen, const Eigen::Vector3f& ray, const Eigen::Vector3f& ray_dx,
                      const Eigen::Vector3f& ray_dy) const {
  const Quad& quad = world_->quads()[static_cast<std::size_t>(seen.quad)];
  const float facing = seen.normal.dot(ray), t = seen.height / facing;
  const float ud = seen.u.dot(ray), vd = seen.v.dot(ray);
  // d(t ray) / dx = t (ray_dx - ray (n . ray_dx) / (n . ray)), and its components along u and v.
  const float slope_x = seen.normal.dot(ray_dx) / facing, slope_y = seen.normal.dot(ray_dy) / facing;
  const float ku = quad.texels_per_m_u, kv = quad.texels_per_m_v;
  const float value = world_->textures()[static_cast<std::size_t>(quad.texture)].Sample(
      ku * (t * ud - seen.u0), kv * (t * vd - seen.v0), ku * t * (seen.u.dot(ray_dx) - ud * slope_x),
      kv * t * (seen.v.dot(ray_dx) - vd * slope_x), ku * t * (seen.u.dot(ray_dy) - ud * slope_y),
      kv * t * (seen.v.dot(ray_dy) - vd * slope_y));
  return value * quad.shade * (1.0f / 255.0f);
}

// Nine rays over the pixel, tried against the quads that the pixel and its neighbours see.
float Renderer::ShadeEdge(const Frame& frame, const Strip& strip, int x, int y, const Eigen::Vector3f& ray_dx,
                          const Eigen::Vector3f& ray_dy) const {
  std::array<int, 9> near{};
  int count = 0;
  for (int yy = std::max(0, y - 1); yy <= std::min(camera_.height_px - 1, y + 1); ++yy) {
    for (int xx = std::max(0, x - 1); xx <= std::min(camera_.width_px - 1, x + 1); ++xx) {
      const int quad = frame.quad[static_cast<std::size_t>(yy * camera_.width_px + xx)];
      if (quad < 0) continue;
      const int seen = strip.seen_of_quad[static_cast<std::size_t>(quad)];
      if (seen >= 0 && std::find(near.begin(), near.begin() + count, seen) == near.begin() + count) {
        near[static_cast<std::size_t>(count++)] = seen;
      }
    }
  }
  // Which of them each ray hits; a quad is then shaded once, in the middle of the rays that hit it.
  const Eigen::Vector3f center = Ray(x, y);
  std::array<int, 9> hits{}, right{}, down{};
  int misses = 9;
  for (int k = 0; k < 9; ++k) {
    const int dx = k % 3 - 1, dy = k / 3 - 1;
    const Eigen::Vector3f ray =
        center + static_cast<float>(dx) / 3.0f * ray_dx + static_cast<float>(dy) / 3.0f * ray_dy;
    float best = std::numeric_limits<float>::max();
    int nearest = -1;
    for (int i = 0; i < count; ++i) {
      const Seen& s = strip.seen[static_cast<std::size_t>(near[static_cast<std::size_t>(i)])];
      const float facing = s.normal.dot(ray);
      if (facing >= 0.0f) continue;
      const float t = s.height / facing, u = t * s.u.dot(ray) - s.u0, v = t * s.v.dot(ray) - s.v0;
      if (t >= best || u < -kOverlap || v < -kOverlap || u > s.size_u + kOverlap || v > s.size_v + kOverlap) continue;
      best = t;
      nearest = i;
    }
    if (nearest < 0) continue;
    --misses;
    ++hits[static_cast<std::size_t>(nearest)];
    right[static_cast<std::size_t>(nearest)] += dx;
    down[static_cast<std::size_t>(nearest)] += dy;
  }
  float sum = static_cast<float>(misses) * kNothing;
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    if (hits[i] == 0) continue;
    const float n = static_cast<float>(hits[i]);
    const Eigen::Vector3f ray =
        center + static_cast<float>(right[i]) / (3.0f * n) * ray_dx + static_cast<float>(down[i]) / (3.0f * n) * ray_dy;
    sum += n * Shade(strip.seen[static_cast<std::size_t>(near[i])], ray, ray_dx, ray_dy);
  }
  return sum / 9.0f;
}

void Renderer::AddLight(const Frame& frame, std::vector<float>& light) const {
  const int w = camera_.width_px, h = camera_.height_px;
  for (const Strip& strip : frame.strips) {
    for (int y = strip.first_tile_row * kTile; y < std::min(strip.end_tile_row * kTile, h); ++y) {
      const int* row = &frame.quad[static_cast<std::size_t>(y * w)];
      const int* above = y > 0 ? row - w : row;
      const int* below = y < h - 1 ? row + w : row;
      for (int x = 0; x < w; ++x) {
        const std::size_t at = static_cast<std::size_t>(y * w + x);
        const int quad = row[x];
        const bool edge = above[x] != quad || below[x] != quad || row[std::max(0, x - 1)] != quad ||
                          row[std::min(w - 1, x + 1)] != quad;
        if (quad < 0 && !edge) {
          light[at] += kNothing;
          continue;
        }
        const Eigen::Vector3f& ray = rays_[at];
        const Eigen::Vector3f ray_dx =
            x < w - 1 ? Eigen::Vector3f(rays_[at + 1] - ray) : Eigen::Vector3f(ray - rays_[at - 1]);
        const Eigen::Vector3f ray_dy = y < h - 1 ? Eigen::Vector3f(rays_[at + static_cast<std::size_t>(w)] - ray)
                                                 : Eigen::Vector3f(ray - rays_[at - static_cast<std::size_t>(w)]);
        light[at] +=
            edge ? ShadeEdge(frame, strip, x, y, ray_dx, ray_dy)
                 : Shade(strip.seen[static_cast<std::size_t>(strip.seen_of_quad[static_cast<std::size_t>(quad)])], ray,
                         ray_dx, ray_dy);
      }
    }
  }
}

int Renderer::BlurSamples(const Shot& shot) const {
  if (effects_.max_blur_samples <= 1 || shot.exposure_s <= 0.0) return 1;
  const SE3 motion = shot.world_from_camera(shot.time_s - 0.5 * shot.exposure_s).Inverse() *
                     shot.world_from_camera(shot.time_s + 0.5 * shot.exposure_s);
  // Things are some 1.5 m away. A pixel is as wide as the filter of its texture, so one image per pixel of motion
  // leaves no gaps.
  const double motion_px = camera_.fx_px * (AngleRad(motion.rotation()) + motion.translation().norm() / 1.5);
  return std::clamp(static_cast<int>(std::lround(motion_px)), 1, effects_.max_blur_samples);
}

cv::Mat Renderer::Develop(const std::vector<float>& light, float gain, std::uint64_t noise_seed) const {
  const int w = camera_.width_px, h = camera_.height_px;
  cv::Mat image(h, w, CV_8UC1);
  const float dark = static_cast<float>(effects_.noise_dark * effects_.noise_dark);
  const float bright = static_cast<float>(effects_.noise_bright * effects_.noise_bright) - dark;
  const bool noisy = effects_.noise_dark > 0.0 || effects_.noise_bright > 0.0;
  const std::uint64_t seed = Random(noise_seed).Next();
  for (int y = 0; y < h; ++y) {
    const float* vignette = vignette_.ptr<float>(y);
    std::uint8_t* out = image.ptr<std::uint8_t>(y);
    for (int x = 0; x < w; ++x) {
      const std::size_t at = static_cast<std::size_t>(y * w + x);
      const float e = std::clamp(light[at] * gain * vignette[x], 0.0f, 1.0f);
      float value = response_[static_cast<std::size_t>(e * (kResponseSteps - 1) + 0.5f)];
      if (noisy) {
        // Four uniform 16-bit numbers: their sum is near enough to normal, with standard deviation 65536 / sqrt(3).
        const std::uint64_t bits = Random(seed + at * 0x9E3779B97F4A7C15ull).Next();
        const float sum =
            static_cast<float>((bits & 0xFFFF) + ((bits >> 16) & 0xFFFF) + ((bits >> 32) & 0xFFFF) + (bits >> 48));
        value += std::sqrt(std::max(0.0f, dark + bright * e)) * (sum - 131070.0f) * (1.7320508f / 65536.0f);
      }
      out[x] = static_cast<std::uint8_t>(std::clamp(value + 0.5f, 0.0f, 255.0f));
    }
  }
  return image;
}

cv::Mat Renderer::Render(const Shot& shot) const {
  std::vector<float> light(rays_.size(), 0.0f);
  const int samples = BlurSamples(shot);
  for (int k = 0; k < samples; ++k) {
    const double offset_s = shot.exposure_s * ((k + 0.5) / samples - 0.5);
    AddLight(Cast(shot.world_from_camera, shot.time_s + offset_s), light);
  }
  const double gain = shot.relative_exposure * effects_.white_level / 255.0 / samples;
  return Develop(light, static_cast<float>(gain), shot.noise_seed);
}

cv::Mat Renderer::Render(const SE3& world_from_camera, std::uint64_t noise_seed) const {
  return Render(
      Shot{.world_from_camera = [world_from_camera](double) { return world_from_camera; }, .noise_seed = noise_seed});
}

cv::Mat Renderer::Depth(const SE3& world_from_camera) const {
  Frame frame;
  frame.quad.assign(rays_.size(), -1);
  frame.distance.assign(rays_.size(), 0.0f);
  frame.strips.push_back(MakeStrip(world_from_camera, 0, tiles_y_));
  CastStrip(frame.strips[0], frame);
  cv::Mat depth(camera_.height_px, camera_.width_px, CV_32FC1);
  for (std::size_t i = 0; i < rays_.size(); ++i) {
    depth.ptr<float>()[i] = frame.quad[i] < 0 ? 0.0f : frame.distance[i] * rays_[i].z();
  }
  return depth;
}

}  // namespace cairn::synth

#include "synth/world.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "base/guarded.h"
#include "base/random.h"
#include "synth/world_builder.h"

namespace cairn::synth {
namespace {

// Light from above and from the ends more than from the sides, so that faces of one box differ; the same after half a
// turn.
float ShadeOf(const Vector3d& normal) {
  const double side = 0.72 + 0.16 * std::abs(normal.x()) + 0.04 * std::abs(normal.y());
  return static_cast<float>(normal.z() > 0.5 ? 1.0 : normal.z() < -0.5 ? 0.8 : side);
}

// A wall is darker where it meets others.
void ShadeEdges(cv::Mat& image, double texels_per_m) {
  const double reach = 0.35 * texels_per_m;
  std::vector<float> across(static_cast<std::size_t>(image.cols)), down(static_cast<std::size_t>(image.rows));
  const auto fill = [reach](std::vector<float>& gain) {
    const double n = static_cast<double>(gain.size());
    for (std::size_t i = 0; i < gain.size(); ++i) {
      const double edge = std::min(static_cast<double>(i) + 0.5, n - static_cast<double>(i) - 0.5);
      gain[i] = static_cast<float>(1.0 - 0.28 * std::exp(-edge / reach * 2.0));
    }
  };
  fill(across);
  fill(down);
  for (int y = 0; y < image.rows; ++y) {
    auto* row = image.ptr<std::uint8_t>(y);
    for (int x = 0; x < image.cols; ++x) {
      row[x] = static_cast<std::uint8_t>(
          static_cast<float>(row[x]) * across[static_cast<std::size_t>(x)] * down[static_cast<std::size_t>(y)] + 0.5f);
    }
  }
}

}  // namespace

std::uint64_t Derive(std::uint64_t seed, std::uint64_t index) {
  return Random(seed ^ (0xD1B54A32D192ED03ull * (index + 1))).Next();
}

Vector3d Place::ToWorld(const Vector3d& local) const {
  const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  return origin + Vector3d(c * local.x() - s * local.y(), s * local.x() + c * local.y(), local.z());
}

Place Place::At(double x, double y, double extra_yaw_rad) const {
  return {ToWorld({x, y, 0.0}), yaw_rad + extra_yaw_rad};
}

void WorldBuilder::AddRectangle(const Vector3d& corner, const Vector3d& right, const Vector3d& down, double width_m,
                                double height_m, Material material, std::uint64_t seed, bool edges_shaded,
                                bool is_floor) {
  Quad quad;
  quad.corner = corner.cast<float>();
  quad.u = right.cast<float>();
  quad.v = down.cast<float>();
  const Vector3d normal = down.cross(right);
  quad.normal = normal.cast<float>();
  quad.size_u_m = static_cast<float>(width_m);
  quad.size_v_m = static_cast<float>(height_m);
  quad.shade = ShadeOf(normal);
  quad.texture = static_cast<int>(paints_.size());
  world_.quads_.push_back(quad);
  paints_.push_back({material, width_m, height_m, seed, edges_shaded, is_floor});
}

void WorldBuilder::AddBox(const Place& place, const Extent& e, Material material, std::uint64_t seed, unsigned faces) {
  AddPanel(place, e, material, material, seed, faces);
}

void WorldBuilder::AddPanel(const Place& place, const Extent& e, Material front, Material rest, std::uint64_t seed,
                            unsigned faces) {
  const Place axes{Vector3d::Zero(), place.yaw_rad};
  const Vector3d ex = axes.ToWorld({1, 0, 0}), ey = axes.ToWorld({0, 1, 0}), ez(0, 0, 1);
  const double w = e.x1 - e.x0, d = e.y1 - e.y0, h = e.z1 - e.z0;
  const auto at = [&](double x, double y, double z) { return place.ToWorld({x, y, z}); };
  if (faces & kFront) AddRectangle(at(e.x0, e.y0, e.z1), ex, -ez, w, h, front, Derive(seed, 0));
  if (faces & kBack) AddRectangle(at(e.x1, e.y1, e.z1), -ex, -ez, w, h, rest, Derive(seed, 1));
  if (faces & kLeft) AddRectangle(at(e.x0, e.y1, e.z1), -ey, -ez, d, h, rest, Derive(seed, 2));
  if (faces & kRight) AddRectangle(at(e.x1, e.y0, e.z1), ey, -ez, d, h, rest, Derive(seed, 3));
  if (faces & kTop) AddRectangle(at(e.x0, e.y1, e.z1), ex, -ey, w, d, rest, Derive(seed, 4));
  if (faces & kBottom) AddRectangle(at(e.x0, e.y0, e.z0), ex, ey, w, d, rest, Derive(seed, 5));
  if (e.z0 < 0.12 && e.z1 > 0.02) {
    std::vector<cv::Point2d> footprint;
    for (const auto& [x, y] : {std::pair{e.x0, e.y0}, {e.x1, e.y0}, {e.x1, e.y1}, {e.x0, e.y1}}) {
      const Vector3d p = at(x, y, 0);
      footprint.emplace_back(p.x(), p.y());
    }
    footprints_.push_back(footprint);
  }
}

cv::Mat WorldBuilder::PaintTexture(const Paint& paint, const Quad& quad) const {
  const double density = world_.options_.texels_per_m;
  cv::Mat image = MakeMaterial(paint.material, paint.width_m, paint.height_m, density, paint.seed);
  if (paint.edges_shaded) ShadeEdges(image, density);
  if (!paint.is_floor) return image;
  // Soft shadows where furniture stands, at a coarse resolution.
  const double scale = 40.0;
  cv::Mat shadow(static_cast<int>(paint.height_m * scale) + 1, static_cast<int>(paint.width_m * scale) + 1, CV_32FC1,
                 cv::Scalar(1.0));
  for (const auto& footprint : footprints_) {
    std::vector<cv::Point> corners;
    for (const cv::Point2d& p : footprint) {
      const Eigen::Vector3f offset = Eigen::Vector3f(static_cast<float>(p.x), static_cast<float>(p.y), 0) - quad.corner;
      corners.emplace_back(static_cast<int>(offset.dot(quad.u) * scale), static_cast<int>(offset.dot(quad.v) * scale));
    }
    cv::fillConvexPoly(shadow, corners, cv::Scalar(0.45));
  }
  cv::GaussianBlur(shadow, shadow, cv::Size(0, 0), 0.12 * scale);
  cv::Mat large;
  cv::resize(shadow, large, image.size(), 0, 0, cv::INTER_LINEAR);
  cv::multiply(image, large, image, 1.0, CV_8UC1);
  return image;
}

World WorldBuilder::Finish() {
  world_.textures_.resize(paints_.size());
  std::atomic<std::size_t> next = 0;
  const auto work = [&] {
    for (std::size_t i = next++; i < paints_.size(); i = next++) {
      world_.textures_[i] = Texture(PaintTexture(paints_[i], world_.quads_[i]));
    }
  };
  RunInThreads(world_.options_.threads, work);
  for (Quad& quad : world_.quads_) {
    const Texture& texture = world_.textures_[static_cast<std::size_t>(quad.texture)];
    quad.texels_per_m_u = static_cast<float>(texture.width()) / quad.size_u_m;
    quad.texels_per_m_v = static_cast<float>(texture.height()) / quad.size_v_m;
  }
  return std::move(world_);
}

absl::Status WorldOptions::Validate() const {
  const auto bad = [](const std::string& what) { return absl::InvalidArgumentError("world: " + what); };
  if (!size_m.allFinite() || size_m.minCoeff() < 2.0 || size_m.maxCoeff() > 200.0) {
    return bad("size_m must be between 2 and 200 m each way");
  }
  if (kind == WorldKind::kRoom && std::min(size_m.x(), size_m.y()) < 3.0) return bad("a room is at least 3 m wide");
  if (kind == WorldKind::kCorridor) {
    if (!(corridor_width_m >= 1.2 && corridor_width_m <= 10.0)) return bad("corridor_width_m must be in [1.2, 10]");
    if (std::min(size_m.x(), size_m.y()) < 2.0 * corridor_width_m + 1.0) {
      return bad("a corridor's outer wall must leave at least 1 m of building inside the loop");
    }
  }
  if (kind == WorldKind::kRooms) {
    if (!(corridor_width_m >= 1.2 && corridor_width_m <= 0.5 * size_m.y())) {
      return bad("the passage between rooms must be at least 1.2 m and at most half of a room wide");
    }
    if (!(passage_length_m >= 1.0 && passage_length_m <= 50.0)) return bad("passage_length_m must be in [1, 50]");
    if (std::min(0.5 * (size_m.x() - passage_length_m), size_m.y()) < 4.0) {
      return bad("two rooms and the passage between them need rooms of at least 4 m");
    }
  }
  if (!(blank_share >= 0.0 && blank_share <= 1.0)) return bad("blank_share must be in [0, 1]");
  if (!(furniture_density >= 0.0 && furniture_density <= 1.0)) return bad("furniture_density must be in [0, 1]");
  if (!(texels_per_m >= 20.0 && texels_per_m <= 2000.0)) return bad("texels_per_m must be in [20, 2000]");
  if (threads < 1 || threads > 256) return bad("threads must be in [1, 256]");
  return absl::OkStatus();
}

absl::StatusOr<World> World::Create(const WorldOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  WorldBuilder builder(options);
  switch (options.kind) {
    case WorldKind::kRoom:
      BuildRoom(builder, options);
      break;
    case WorldKind::kCorridor:
      BuildCorridor(builder, options);
      break;
    case WorldKind::kRooms:
      BuildRooms(builder, options);
      break;
  }
  return builder.Finish();
}

std::optional<Hit> World::Cast(const Vector3d& origin_w, const Vector3d& direction_w) const {
  const Vector3d d = direction_w.normalized();
  std::optional<Hit> best;
  for (std::size_t i = 0; i < quads_.size(); ++i) {
    const Quad& q = quads_[i];
    const Vector3d n = q.normal.cast<double>();
    const double facing = n.dot(d), height = n.dot(q.corner.cast<double>() - origin_w);
    if (facing >= 0.0 || height >= 0.0) continue;
    const double t = height / facing;
    if (best.has_value() && t >= best->distance_m) continue;
    const Vector3d p = origin_w + t * d, offset = p - q.corner.cast<double>();
    const double u = offset.dot(q.u.cast<double>()), v = offset.dot(q.v.cast<double>());
    if (u < 0.0 || v < 0.0 || u > q.size_u_m || v > q.size_v_m) continue;
    best = Hit{static_cast<int>(i), t, p};
  }
  return best;
}

}  // namespace cairn::synth

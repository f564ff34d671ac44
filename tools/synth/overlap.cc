#include "synth/overlap.h"

#include <algorithm>
#include <cmath>

namespace cairn::synth {
namespace {

constexpr double kHidden = 1.03;  // times the depth that is seen: further away is hidden

Camera Reduced(const Camera& camera, int columns) {
  const double scale = static_cast<double>(columns) / camera.width_px;
  const int rows = std::max(16, static_cast<int>(std::lround(camera.height_px * scale)));
  return Camera::FromPinhole({columns, rows, camera.fx_px * scale, camera.fy_px * scale,
                              (camera.cx_px + 0.5) * scale - 0.5, (camera.cy_px + 0.5) * scale - 0.5});
}

// An image: where it was taken, and what is how far away.
struct View {
  SE3 camera_from_world;
  Vector3d center = Vector3d::Zero();
  cv::Mat depth;
};

View Look(const Renderer& renderer, const SE3& world_from_camera) {
  return {world_from_camera.Inverse(), world_from_camera.translation(), renderer.Depth(world_from_camera)};
}

// Whether the point, in the view's camera frame, is the surface that it shows there: no further than the furthest of
// the four pixels around.
bool Shows(const View& view, const Pinhole& pinhole, const Vector3d& point_c) {
  if (point_c.z() < 0.05) return false;
  const Vector2d pixel = pinhole.Project(point_c);
  if (!pinhole.Contains(pixel, 1)) return false;
  const int x = static_cast<int>(pixel.x()), y = static_cast<int>(pixel.y());
  float furthest = 0.0f;
  for (const int yy : {y, y + 1}) {
    for (const int xx : {x, x + 1}) furthest = std::max(furthest, view.depth.at<float>(yy, xx));
  }
  return point_c.z() <= kHidden * furthest;
}

double ShareSeen(const std::vector<Vector3d>& points_w, const Vector3d& from, double from_focal, const View& other,
                 const Pinhole& pinhole, double other_focal, const OverlapOptions& options) {
  int seen = 0;
  for (const Vector3d& point : points_w) {
    const Vector3d ray = point - from, other_ray = point - other.center;
    const double distance = ray.norm(), other_distance = other_ray.norm();
    const double ratio = (distance / from_focal) / (other_distance / other_focal);
    if (ratio > options.max_distance_ratio || ratio < 1.0 / options.max_distance_ratio) continue;
    if (ray.dot(other_ray) < std::cos(options.max_angle_rad) * distance * other_distance) continue;
    if (Shows(other, pinhole, other.camera_from_world * point)) ++seen;
  }
  return points_w.empty() ? 0.0 : static_cast<double>(seen) / static_cast<double>(points_w.size());
}

}  // namespace

absl::Status OverlapOptions::Validate() const {
  if (columns < 16 || columns > 1000) return absl::InvalidArgumentError("overlap: columns must be in [16, 1000]");
  if (!(max_angle_rad > 0.0 && max_angle_rad < 3.2) || !(max_distance_ratio >= 1.0) || !(step_s > 0.0)) {
    return absl::InvalidArgumentError("overlap: angle and step must be positive, the ratio of distances at least 1");
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<double>> SharedViews(const Sequence& sequence, const SequenceOptions& other,
                                                const OverlapOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_ASSIGN_OR_RETURN(const Trajectory path, Trajectory::Create(other.world, other.trajectory));
  const Camera camera = Reduced(sequence.options().camera, options.columns);
  // Finer, as depths are compared between its pixels.
  const Camera other_camera = Reduced(other.camera, 4 * options.columns);
  CAIRN_ASSIGN_OR_RETURN(const Renderer renderer, Renderer::Create(sequence.world(), camera, {}));
  CAIRN_ASSIGN_OR_RETURN(const Renderer other_renderer, Renderer::Create(sequence.world(), other_camera, {}));
  double end_s = path.duration_s();
  if (other.max_duration_s > 0.0) end_s = std::min(end_s, other.max_duration_s);
  std::vector<View> others;
  for (double t = 0.0; t <= end_s; t += options.step_s) others.push_back(Look(other_renderer, path.Pose(t)));

  const Pinhole pinhole = camera.Intrinsics(), other_pinhole = other_camera.Intrinsics();
  std::vector<double> shares;
  for (int i = 0; i < sequence.size(); ++i) {
    const SE3 world_from_camera = sequence.WorldFromCamera(i);
    const View view = Look(renderer, world_from_camera);
    std::vector<Vector3d> points;
    for (int y = 0; y < view.depth.rows; ++y) {
      for (int x = 0; x < view.depth.cols; ++x) {
        const double depth = view.depth.at<float>(y, x);
        if (depth > 0.0) points.push_back(world_from_camera * Vector3d(depth * pinhole.Unproject({x, y})));
      }
    }
    double share = 0.0;
    for (const View& candidate : others) {
      share = std::max(share, ShareSeen(points, view.center, sequence.options().camera.fx_px, candidate, other_pinhole,
                                        other.camera.fx_px, options));
    }
    shares.push_back(share);
  }
  return shares;
}

}  // namespace cairn::synth

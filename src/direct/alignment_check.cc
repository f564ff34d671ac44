#include "direct/alignment_check.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace cairn::direct {
namespace {

constexpr int kColumns = kCellColumns;
constexpr int kRows = kCellRows;
constexpr int kMinCellPoints = 10;
constexpr double kMinSigmaGray = 3.0;  // of a cell of the reference: below it there is no pattern

struct CellSums {
  int points = 0;   // of the reference
  int visible = 0;  // of these, inside the image
  double x = 0.0, y = 0.0, xx = 0.0, yy = 0.0, xy = 0.0;
};

std::size_t CellOf(const Pinhole& camera, float x_px, float y_px) {
  const int column = std::min(kColumns - 1, static_cast<int>(x_px) * kColumns / camera.width_px);
  const int row = std::min(kRows - 1, static_cast<int>(y_px) * kRows / camera.height_px);
  return static_cast<std::size_t>(row * kColumns + column);
}

}  // namespace

AlignmentAgreement CheckAlignment(const PyramidGeometry& geometry, const TrackingReference& reference,
                                  const ImagePyramid& image, const SE3& new_from_reference) {
  // One level above the finest: enough points per cell, and tolerant of blur.
  const int level = std::min(1, geometry.levels - 1);
  const Pinhole& camera = geometry.camera[level];
  const TrackingReference::Level& points = reference.level[level];
  const Matrix3d rotation = new_from_reference.RotationMatrix();
  std::array<CellSums, kColumns* kRows> cells = {};
  for (int i = 0; i < points.count; ++i) {
    CellSums& cell = cells[CellOf(camera, points.x[i], points.y[i])];
    ++cell.points;
    const Vector3d moved = rotation * camera.Unproject(Vector2d(points.x[i], points.y[i])) +
                           static_cast<double>(points.inverse_depth[i]) * new_from_reference.translation();
    if (moved.z() < 1e-3) continue;
    const Vector2d pixel = camera.Project(moved);
    if (!camera.Contains(pixel, 2.0)) continue;
    const int u = static_cast<int>(pixel.x()), v = static_cast<int>(pixel.y());
    const double a = pixel.x() - u, b = pixel.y() - v;
    const double value = (1.0 - b) * ((1.0 - a) * image.At(level, u, v)[0] + a * image.At(level, u + 1, v)[0]) +
                         b * ((1.0 - a) * image.At(level, u, v + 1)[0] + a * image.At(level, u + 1, v + 1)[0]);
    const double color = points.color[i];
    ++cell.visible;
    cell.x += color, cell.y += value;
    cell.xx += color * color, cell.yy += value * value, cell.xy += color * value;
  }
  AlignmentAgreement agreement;
  for (std::size_t k = 0; k < cells.size(); ++k) {
    const CellSums& cell = cells[k];
    if (cell.visible < kMinCellPoints || 2 * cell.visible < cell.points) continue;
    const double n = cell.visible;
    const double var_x = cell.xx / n - (cell.x / n) * (cell.x / n);
    const double var_y = cell.yy / n - (cell.y / n) * (cell.y / n);
    if (var_x < kMinSigmaGray * kMinSigmaGray) continue;
    ++agreement.cells;
    const double covariance = cell.xy / n - (cell.x / n) * (cell.y / n);
    const double sigmas = var_y > 1e-3 ? std::sqrt(var_x * var_y) : 0.0;
    if (sigmas > 0.0 && covariance > kAgreeingCorrelation * sigmas) ++agreement.agreeing;
    agreement.disagreeing[k] = sigmas <= 0.0 || covariance < kDisagreeingCorrelation * sigmas;
  }
  return agreement;
}

void WithoutCells(const PyramidGeometry& geometry, const TrackingReference& reference, const CellSet& without,
                  TrackingReference* rest) {
  rest->keyframe = reference.keyframe;
  rest->light = reference.light;
  rest->exposure_gain = reference.exposure_gain;
  rest->mean_inverse_depth = reference.mean_inverse_depth;
  for (int level = 0; level < geometry.levels; ++level) {
    const TrackingReference::Level& from = reference.level[level];
    TrackingReference::Level& to = rest->level[level];
    to.x.clear(), to.y.clear(), to.inverse_depth.clear(), to.color.clear();
    for (int i = 0; i < from.count; ++i) {
      if (without[CellOf(geometry.camera[level], from.x[i], from.y[i])]) continue;
      to.x.push_back(from.x[i]), to.y.push_back(from.y[i]);
      to.inverse_depth.push_back(from.inverse_depth[i]), to.color.push_back(from.color[i]);
    }
    PadLevel(&to);
  }
}

}  // namespace cairn::direct

#include "direct/alignment_check.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace cairn::direct {
namespace {

constexpr int kColumns = 8;
constexpr int kRows = 6;
constexpr int kMinCellPoints = 10;
constexpr double kMinSigmaGray = 3.0;  // of a cell of the reference: below it there is no pattern

struct CellSums {
  int points = 0;   // of the reference
  int visible = 0;  // of these, inside the image
  double x = 0.0, y = 0.0, xx = 0.0, yy = 0.0, xy = 0.0;
};

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
    const int column = std::min(kColumns - 1, static_cast<int>(points.x[i]) * kColumns / camera.width_px);
    const int row = std::min(kRows - 1, static_cast<int>(points.y[i]) * kRows / camera.height_px);
    CellSums& cell = cells[static_cast<std::size_t>(row * kColumns + column)];
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
  for (const CellSums& cell : cells) {
    if (cell.visible < kMinCellPoints || 2 * cell.visible < cell.points) continue;
    const double n = cell.visible;
    const double var_x = cell.xx / n - (cell.x / n) * (cell.x / n);
    const double var_y = cell.yy / n - (cell.y / n) * (cell.y / n);
    if (var_x < kMinSigmaGray * kMinSigmaGray) continue;
    ++agreement.cells;
    const double covariance = cell.xy / n - (cell.x / n) * (cell.y / n);
    if (var_y > 1e-3 && covariance > kAgreeingCorrelation * std::sqrt(var_x * var_y)) ++agreement.agreeing;
  }
  return agreement;
}

}  // namespace cairn::direct

#include "direct/alignment_check.h"

#include <algorithm>
#include <cmath>

namespace cairn::direct {
namespace {

constexpr int kMinCellPoints = 10;
constexpr double kMinSigmaGray = 3.0;  // of a cell of the reference: below it there is no pattern
constexpr int kBorderPx = 2;

struct Sums {
  int n = 0;
  double x = 0.0, y = 0.0, xx = 0.0, yy = 0.0, xy = 0.0;
  void Add(double a, double b) {
    ++n;
    x += a, y += b;
    xx += a * a, yy += b * b, xy += a * b;
  }
  double VarX() const { return xx / n - (x / n) * (x / n); }
  double VarY() const { return yy / n - (y / n) * (y / n); }
  double Correlation() const {
    const double var_y = VarY(), sigmas = var_y > 1e-3 ? std::sqrt(VarX() * var_y) : 0.0;
    return sigmas > 0.0 ? (xy / n - (x / n) * (y / n)) / sigmas : 0.0;
  }
};

}  // namespace

double CellMatcher::Correlation(const Cell& cell, const ImagePyramid& image, int level, int dx, int dy) {
  const int width = image.Width(level), height = image.Height(level);
  Sums sums;
  for (const Sample& s : cell.visible) {
    const int u = s.u + dx, v = s.v + dy;
    if (u < 0 || v < 0 || u + 1 >= width || v + 1 >= height) continue;
    const float *above = image.At(level, u, v), *below = image.At(level, u, v + 1);
    const double value = (1.0f - s.b) * ((1.0f - s.a) * above[0] + s.a * above[ImagePyramid::kChannels]) +
                         s.b * ((1.0f - s.a) * below[0] + s.a * below[ImagePyramid::kChannels]);
    sums.Add(s.color, value);
  }
  const bool enough = sums.n >= kMinCellPoints && sums.VarX() >= kMinSigmaGray * kMinSigmaGray;
  return enough ? sums.Correlation() : 0.0;
}

CellMatches CellMatcher::Match(const PyramidGeometry& geometry, const TrackingReference& reference,
                               const ImagePyramid& image, const SE3& new_from_reference, CellGrid grid, int reach_px) {
  // One level above the finest: enough points per cell, and tolerant of blur.
  const int level = std::min(1, geometry.levels - 1);
  const Pinhole& camera = geometry.camera[level];
  const TrackingReference::Level& points = reference.level[level];
  const Matrix3d rotation = new_from_reference.RotationMatrix();
  for (Cell& cell : cells_) cell.points = 0, cell.visible.clear();
  for (int i = 0; i < points.count; ++i) {
    const Vector2d from(points.x[i], points.y[i]);
    const Vector3d moved = rotation * camera.Unproject(from) +
                           static_cast<double>(points.inverse_depth[i]) * new_from_reference.translation();
    const bool ahead = moved.z() > 1e-3;
    const Vector2d pixel = ahead ? camera.Project(moved) : from;
    const bool visible = ahead && camera.Contains(pixel, kBorderPx);
    if (grid == CellGrid::kImage && !visible) continue;
    const Vector2d& at = grid == CellGrid::kImage ? pixel : from;
    Cell& cell = cells_[CellOf(camera, at.x(), at.y())];
    ++cell.points;
    if (!visible) continue;
    const int u = static_cast<int>(pixel.x()), v = static_cast<int>(pixel.y());
    cell.visible.push_back(
        {u, v, static_cast<float>(pixel.x() - u), static_cast<float>(pixel.y() - v), points.color[i]});
  }
  CellMatches matches;
  for (std::size_t k = 0; k < cells_.size(); ++k) {
    const Cell& cell = cells_[k];
    const int visible = static_cast<int>(cell.visible.size());
    if (visible < kMinCellPoints || 2 * visible < cell.points) continue;
    Sums sums;
    for (const Sample& sample : cell.visible) sums.Add(sample.color, sample.color);
    if (sums.VarX() < kMinSigmaGray * kMinSigmaGray) continue;
    CellMatch& match = matches[k];
    match.known = true;
    match.correlation = Correlation(cell, image, level, 0, 0);
    for (int dy = -reach_px; dy <= reach_px && match.correlation < kAgreeingCorrelation; ++dy) {
      for (int dx = -reach_px; dx <= reach_px; ++dx) {
        match.correlation = std::max(match.correlation, Correlation(cell, image, level, dx, dy));
      }
    }
  }
  return matches;
}

AlignmentAgreement AgreementOf(const CellMatches& matches) {
  AlignmentAgreement agreement;
  for (std::size_t k = 0; k < matches.size(); ++k) {
    if (!matches[k].known) continue;
    ++agreement.cells;
    agreement.agreeing += matches[k].correlation > kAgreeingCorrelation;
    agreement.disagreeing[k] = matches[k].correlation < kDisagreeingCorrelation;
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

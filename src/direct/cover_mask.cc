#include "direct/cover_mask.h"

#include <algorithm>
#include <cmath>

namespace cairn::direct {
namespace {

constexpr int kMinPoints = 5;             // tracked ones, to judge a cell by
constexpr double kCoveredShare = 0.6;     // of a cell's points that do not fit
constexpr double kMaxCoveredCells = 0.8;  // of those judged: more, and it is the alignment or the light
constexpr int kMinFitting = 3;            // tracked points that tell for themselves
constexpr double kMinTurnPx = 3.0;
constexpr double kMinChangeGray = 15.0;  // that a shift by kMinTurnPx makes: enough to see
constexpr double kStillGray = 6.0;
constexpr int kMinStillPixels = 12;
constexpr double kStillShare = 0.8;
constexpr int kMinCellPoints = 10;
constexpr double kMinSigmaGray = 3.0;
constexpr double kSameCorrelation = 0.7;
constexpr double kMaxCoveredS = 1.0;  // without a new sign

}  // namespace

void CoverMask::Reset() {
  cells_ = {};
  covered_cells_ = 0;
}

bool CoverMask::State::IsStill() const {
  const int pixels = still + moves;
  return pixels >= kMinStillPixels && still >= kStillShare * pixels;
}

std::size_t CoverMask::Cell(double x_px, double y_px) const {
  const int column = std::clamp(static_cast<int>(x_px * kColumns / camera_.width_px), 0, kColumns - 1);
  const int row = std::clamp(static_cast<int>(y_px * kRows / camera_.height_px), 0, kRows - 1);
  return static_cast<std::size_t>(row * kColumns + column);
}

void CoverMask::Begin() {
  for (State& cell : cells_) {
    cell.fits = cell.fails = cell.moves = cell.still = 0;
    cell.seen_again = false;
  }
}

void CoverMask::AddTracked(float x_px, float y_px, bool fits) {
  State& cell = cells_[Cell(x_px, y_px)];
  ++(fits ? cell.fits : cell.fails);
}

void CoverMask::AddStill(const ImagePyramid& newest, const ImagePyramid& before, const Matrix3d& newest_from_before,
                         double gain, double offset) {
  const int width = camera_.width_px, height = camera_.height_px;
  for (int k = 0; k < kColumns * kRows; ++k) {
    State& cell = cells_[static_cast<std::size_t>(k)];
    if (cell.fits >= kMinFitting && cell.fits >= cell.fails) continue;
    const int column = k % kColumns, row = k / kColumns;
    const int x0 = std::max(1, column * width / kColumns), x1 = std::min(width - 1, (column + 1) * width / kColumns);
    const int y0 = std::max(1, row * height / kRows), y1 = std::min(height - 1, (row + 1) * height / kRows);
    const Vector2d middle(0.5 * (x0 + x1), 0.5 * (y0 + y1));
    const Vector3d turned = newest_from_before * camera_.Unproject(middle);
    if (turned.z() < 1e-3) continue;
    const Vector2d shift = camera_.Project(turned) - middle;
    if (shift.norm() < kMinTurnPx) continue;
    const Vector2d step = shift * (kMinTurnPx / shift.norm());
    for (int y = y0; y < y1; y += 2) {
      for (int x = x0; x < x1; x += 2) {
        const float* old = before.At(0, x, y);
        if (std::abs(old[1] * step.x() + old[2] * step.y()) < kMinChangeGray) continue;
        const double change = newest.At(0, x, y)[0] - (gain * old[0] + offset);
        ++(std::abs(change) < kStillGray ? cell.still : cell.moves);
      }
    }
  }
}

void CoverMask::AddUncovered(const PyramidGeometry& geometry, const TrackingReference& clear,
                             const ImagePyramid& newest, const SE3& newest_from_clear) {
  // One level above the finest, as the check of an alignment.
  const int level = std::min(1, geometry.levels - 1);
  const Pinhole& camera = geometry.camera[level];
  const TrackingReference::Level& points = clear.level[level];
  struct Sums {
    int n = 0;
    double x = 0.0, y = 0.0, xx = 0.0, yy = 0.0, xy = 0.0;
  };
  std::array<Sums, kColumns* kRows> sums = {};
  const double scale = static_cast<double>(camera_.width_px) / camera.width_px;
  const Matrix3d rotation = newest_from_clear.RotationMatrix();
  for (int i = 0; i < points.count; ++i) {
    const Vector3d moved = rotation * camera.Unproject(Vector2d(points.x[i], points.y[i])) +
                           static_cast<double>(points.inverse_depth[i]) * newest_from_clear.translation();
    if (moved.z() < 1e-3) continue;
    const Vector2d pixel = camera.Project(moved);
    if (!camera.Contains(pixel, 2.0)) continue;
    const std::size_t at = Cell(scale * pixel.x(), scale * pixel.y());
    if (!cells_[at].covered) continue;
    const int u = static_cast<int>(pixel.x()), v = static_cast<int>(pixel.y());
    const double a = pixel.x() - u, b = pixel.y() - v;
    const double value = (1.0 - b) * ((1.0 - a) * newest.At(level, u, v)[0] + a * newest.At(level, u + 1, v)[0]) +
                         b * ((1.0 - a) * newest.At(level, u, v + 1)[0] + a * newest.At(level, u + 1, v + 1)[0]);
    const double color = points.color[i];
    Sums& s = sums[at];
    ++s.n;
    s.x += color, s.y += value;
    s.xx += color * color, s.yy += value * value, s.xy += color * value;
  }
  for (std::size_t k = 0; k < sums.size(); ++k) {
    const Sums& s = sums[k];
    if (s.n < kMinCellPoints) continue;
    const double n = s.n;
    const double var_x = s.xx / n - (s.x / n) * (s.x / n), var_y = s.yy / n - (s.y / n) * (s.y / n);
    if (var_x < kMinSigmaGray * kMinSigmaGray || var_y < 1e-3) continue;
    cells_[k].seen_again = s.xy / n - (s.x / n) * (s.y / n) > kSameCorrelation * std::sqrt(var_x * var_y);
  }
}

void CoverMask::Decide(TimeNs time_ns) {
  const auto fails = [](const State& cell) {
    const int points = cell.fits + cell.fails;
    return points >= kMinPoints && cell.fails >= kCoveredShare * points;
  };
  int judged = 0, failing = 0;
  CellSet suspect = {}, sign = {};
  for (std::size_t k = 0; k < cells_.size(); ++k) {
    const State& cell = cells_[k];
    judged += cell.fits + cell.fails >= kMinPoints;
    failing += fails(cell);
    suspect[k] = fails(cell) || cell.covered;
  }
  const bool local = failing <= kMaxCoveredCells * judged;
  suspect = LargeRegions(suspect);
  for (std::size_t k = 0; k < cells_.size(); ++k) {
    sign[k] = (local && fails(cells_[k]) && suspect[k]) || cells_[k].IsStill();
  }
  covered_cells_ = 0;
  for (int k = 0; k < kColumns * kRows; ++k) {
    State& cell = cells_[static_cast<std::size_t>(k)];
    bool now = sign[static_cast<std::size_t>(k)];
    if (!now && !cell.covered && cell.fits + cell.fails < kMinFitting) {
      // Nothing to judge by: as most of its neighbours.
      int neighbours = 0, covered = 0;
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
          const int x = k % kColumns + dx, y = k / kColumns + dy;
          if ((dx == 0 && dy == 0) || x < 0 || y < 0 || x >= kColumns || y >= kRows) continue;
          ++neighbours;
          covered += sign[static_cast<std::size_t>(y * kColumns + x)];
        }
      }
      now = 2 * covered > neighbours;
    }
    if (now) {
      cell.covered = true;
      cell.last_sign_ns = time_ns;
    } else if (cell.covered) {
      const bool free = cell.seen_again || (cell.fits >= kMinFitting && cell.fits > cell.fails);
      cell.covered = !free && ToSeconds(time_ns - cell.last_sign_ns) < kMaxCoveredS;
    }
    covered_cells_ += cell.covered;
  }
}

}  // namespace cairn::direct

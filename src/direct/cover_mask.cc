#include "direct/cover_mask.h"

#include <algorithm>
#include <cmath>

namespace cairn::direct {
namespace {

constexpr int kMinPoints = 5;             // tracked ones, to judge a cell by
constexpr double kCoveredShare = 0.6;     // of a cell's points that do not fit
constexpr double kMaxCoveredCells = 0.8;  // of those judged: more, and it is the alignment or the light
constexpr int kMinFitting = 3;            // tracked points that tell for themselves
constexpr int kMinCoveredNeighbours = 3;
constexpr double kMinTurnPx = 3.0;
constexpr double kMinChangeGray = 15.0;  // that a shift by kMinTurnPx makes: enough to see
constexpr double kStillGray = 6.0;
constexpr int kMinStillPixels = 12;
constexpr double kStillShare = 0.8;
constexpr double kDifferentCorrelation = 0.5;  // from here up to agreement the points decide
constexpr double kMaxCoveredS = 1.0;           // without a new sign

}  // namespace

void CoverMask::Reset() {
  cells_ = {};
  covered_cells_ = 0;
}

bool CoverMask::State::IsStill() const {
  const int pixels = still + moves;
  return pixels >= kMinStillPixels && still >= kStillShare * pixels;
}

bool CoverMask::State::Moves() const { return still + moves >= kMinStillPixels && !IsStill(); }

bool CoverMask::State::Fits() const {
  if (match.known && match.correlation >= kAgreeingCorrelation) return true;
  if (match.known && match.correlation < kDifferentCorrelation) return false;
  return fits >= kMinFitting && fits > fails;
}

bool CoverMask::State::Fails() const {
  if (match.known && match.correlation >= kAgreeingCorrelation) return false;
  if (match.known && match.correlation < kDifferentCorrelation) return true;
  const int points = fits + fails;
  return points >= kMinPoints && fails >= kCoveredShare * points;
}

// Something could be said of it.
bool CoverMask::State::Judged() const { return match.known || fits + fails >= kMinPoints; }

void CoverMask::Begin() {
  for (State& cell : cells_) {
    cell.fits = cell.fails = cell.moves = cell.still = 0;
    cell.match = {};
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
    if (cell.Fits()) continue;
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

void CoverMask::AddMatches(const CellMatches& matches) {
  for (std::size_t k = 0; k < cells_.size(); ++k) {
    if (matches[k].known && !cells_[k].match.known) cells_[k].match = matches[k];
  }
}

void CoverMask::Decide(TimeNs time_ns) {
  int judged = 0, failing = 0;
  CellSet suspect = {}, sign = {};
  for (std::size_t k = 0; k < cells_.size(); ++k) {
    const State& cell = cells_[k];
    judged += cell.Judged();
    failing += cell.Fails();
    suspect[k] = cell.Fails() || cell.covered;
  }
  const bool local = failing <= kMaxCoveredCells * judged;
  suspect = LargeRegions(suspect);
  for (std::size_t k = 0; k < cells_.size(); ++k) {
    sign[k] = (local && cells_[k].Fails() && suspect[k]) || cells_[k].IsStill();
  }
  covered_cells_ = 0;
  for (int k = 0; k < kColumns * kRows; ++k) {
    State& cell = cells_[static_cast<std::size_t>(k)];
    bool now = sign[static_cast<std::size_t>(k)];
    if (!now && !cell.covered && !cell.Fits() && !cell.Fails()) {
      // Nothing to judge by: as most of those around it of which something is known.
      int decided = 0, covered = 0;
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
          const int x = k % kColumns + dx, y = k / kColumns + dy;
          if ((dx == 0 && dy == 0) || x < 0 || y < 0 || x >= kColumns || y >= kRows) continue;
          const auto neighbour = static_cast<std::size_t>(y * kColumns + x);
          decided += sign[neighbour] || cells_[neighbour].Fits() || cells_[neighbour].Moves();
          covered += sign[neighbour];
        }
      }
      now = covered >= kMinCoveredNeighbours && 2 * covered > decided;
    }
    if (now) {
      cell.covered = true;
      cell.last_sign_ns = time_ns;
    } else if (cell.covered) {
      cell.covered = !cell.Fits() && ToSeconds(time_ns - cell.last_sign_ns) < kMaxCoveredS;
    }
    covered_cells_ += cell.covered;
  }
}

}  // namespace cairn::direct

// Which parts of the view are covered by something that is no part of the rigid world: a board or a hand before the
// lens, someone who walks past. Points must not be chosen there: those on what moves with the camera look like points
// far away and hold the camera still, those on what moves by itself pull it along.
//
// The view is divided into cells; three signs tell, at every keyframe:
//  - the pattern seen there before is not found any more, and the tracked points of a cell cease to fit in bulk, while
//    those elsewhere go on fitting (an obstacle comes in);
//  - the texture of a cell stays where it is in the image although the camera turned (it moves with the camera); this
//    counts only where no tracked points say otherwise, since a turn about a near thing keeps that still as well;
//  - what was seen in a cell before anything was covered, carried over with its depths, is found or not (it is gone
//    again).
// A cell without any sign is given free after kMaxCoveredS, so that what stays becomes part of the world.
#pragma once

#include <array>

#include "base/time.h"
#include "direct/alignment_check.h"
#include "direct/image_pyramid.h"
#include "direct/view_cells.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"

namespace cairn::direct {

class CoverMask {
 public:
  static constexpr int kColumns = kCellColumns;
  static constexpr int kRows = kCellRows;

  // `camera` is that of level 0, in whose pixels all positions are.
  explicit CoverMask(const Pinhole& camera) : camera_(camera) {}

  // Nothing is covered.
  void Reset();

  // The signs of a new keyframe; Decide() ends them.
  void Begin();
  // A point that was tracked so far, where it is expected now, and whether the image is as expected there.
  void AddTracked(float x_px, float y_px, bool fits);
  // What stayed in place although the camera turned. `gain` and `offset` take gray levels of `before` to `newest`.
  void AddStill(const ImagePyramid& newest, const ImagePyramid& before, const Matrix3d& newest_from_before, double gain,
                double offset);
  // How well the pattern seen in each cell before is found where the poses put it (CellGrid::kImage); of several views
  // the first one counts that knows a cell.
  void AddMatches(const CellMatches& matches);
  void Decide(TimeNs time_ns);

  bool any() const { return covered_cells_ > 0; }
  bool Covered(float x_px, float y_px) const { return any() && cells_[Cell(x_px, y_px)].covered; }
  // Covered by what moves with the camera.
  bool Still(float x_px, float y_px) const {
    const State& cell = cells_[Cell(x_px, y_px)];
    return cell.covered && cell.IsStill();
  }

 private:
  struct State {
    bool covered = false;
    TimeNs last_sign_ns = 0;
    // Of this keyframe.
    int fits = 0, fails = 0;
    int moves = 0, still = 0;  // pixels with texture that a turn would have changed
    CellMatch match;
    bool IsStill() const;
    bool Moves() const;
    bool Fits() const;
    bool Fails() const;
    bool Judged() const;
  };

  std::size_t Cell(double x_px, double y_px) const { return CellOf(camera_, x_px, y_px); }

  Pinhole camera_;
  std::array<State, kColumns* kRows> cells_ = {};
  int covered_cells_ = 0;
};

}  // namespace cairn::direct

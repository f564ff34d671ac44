// The inner loops of the Schur solver (schur_solver.h) over plain arrays, compiled once per instruction set: adding the
// normal equations of one point's observations, and eliminating the point from them. Residuals and derivatives are
// those of reprojection.h. Private to optimization.
//
// Columns of six numbers are padded to eight: [6 numbers, 0, 0]. A 6x6 block is six such columns, a 6x3 block three.
#pragma once

#include <cstddef>
#include <cstdint>

namespace cairn {
enum class SimdLevel;  // base/cpu_features.h
}

namespace cairn::optimization::internal {

inline constexpr int kPadded = 8;
inline constexpr int kPoseBlock = 6 * kPadded;   // 6x6
inline constexpr int kCrossBlock = 3 * kPadded;  // pose by point, 6x3

// camera_from_map (rotation by rows) and the pinhole, pixels.
struct SchurCamera {
  double rotation[9];
  double translation[3];
  double fx, fy, cx, cy;
};

// One observation.
struct SchurSight {
  std::uint32_t pose = 0;
  std::int32_t free = -1;  // index among the free poses; -1: fixed
  double u = 0.0, v = 0.0;
  double weight = 1.0;  // 1 / sigma, 1 / pixels
};

// The observations of one point: those of free poses first, by ascending index of the pose, none twice.
struct SchurPoint {
  const SchurSight* sights = nullptr;
  int count = 0;
  int free_count = 0;
};

// Half of the Huber losses' sum is the cost; `huber` 0: squares. The point must be in front of every camera.
// Adds to pose_hessian (a 6x6 block per free pose) and pose_gradient (a column each); sets point_hessian (3x3, by
// columns), point_gradient (3) and `cross` (a 6x3 block per observation of a free pose).
using SchurLinearize = void (*)(const SchurPoint& point, const SchurCamera* cameras, const double* position,
                                double huber, double* pose_hessian, double* pose_gradient, double* point_hessian,
                                double* point_gradient, double* cross);

// Takes the Schur complement of the point: subtracts cross_i inverse cross_j^T from block (i, j) of `reduced` and adds
// cross_i inverse gradient to `right` (a column per free pose). `reduced`: the 6x6 blocks (row, column) of the lower
// triangle, at (row (row + 1) / 2 + column) kPoseBlock. `inverse`: of the point's 3x3, by columns.
using SchurEliminate = void (*)(const SchurPoint& point, const double* inverse, const double* point_gradient,
                                const double* cross, double* reduced, double* right);

struct SchurKernel {
  SchurLinearize linearize;
  SchurEliminate eliminate;
};

// The level must be supported (base/cpu_features.h).
SchurKernel SchurKernelFor(SimdLevel level);

// The kernels behind it.
SchurKernel SchurKernelBaseline();
SchurKernel SchurKernelAvx2();

}  // namespace cairn::optimization::internal

// Bodies of the Schur kernels, compiled once per instruction set. See schur_kernel.h.
#include <cmath>
#include <cstring>

#include "optimization/schur_kernel.h"

namespace cairn::optimization::internal {
namespace {

using V4 = double __attribute__((vector_size(32)));
using V4InMemory = double __attribute__((vector_size(32), aligned(8), may_alias));

// A padded column in two halves.
struct Column {
  V4 low, high;
};

// By pointer: vectors in registers of the baseline's ABI are not passed by value.
inline void Load(const double* from, Column* column) {
  column->low = *reinterpret_cast<const V4InMemory*>(from);
  column->high = *reinterpret_cast<const V4InMemory*>(from + 4);
}
inline void Store(const Column& column, double* to) {
  *reinterpret_cast<V4InMemory*>(to) = column.low;
  *reinterpret_cast<V4InMemory*>(to + 4) = column.high;
}

inline void LinearizeBody(const SchurPoint& point, const SchurCamera* cameras, const double* position, double huber,
                          double* pose_hessian, double* pose_gradient, double* point_hessian, double* point_gradient,
                          double* cross) {
  double hessian[9] = {}, gradient[3] = {};
  for (int i = 0; i < point.count; ++i) {
    const SchurSight& sight = point.sights[i];
    const SchurCamera& camera = cameras[sight.pose];
    const double* r = camera.rotation;
    const double px = r[0] * position[0] + r[1] * position[1] + r[2] * position[2] + camera.translation[0];
    const double py = r[3] * position[0] + r[4] * position[1] + r[5] * position[2] + camera.translation[1];
    const double pz = r[6] * position[0] + r[7] * position[1] + r[8] * position[2] + camera.translation[2];
    const double iz = 1.0 / pz, x = px * iz, y = py * iz;
    const double eu = camera.fx * x + camera.cx - sight.u, ev = camera.fy * y + camera.cy - sight.v;
    double weight = sight.weight * sight.weight;
    if (huber > 0.0) {
      const double chi2 = weight * (eu * eu + ev * ev);
      if (chi2 > huber * huber) weight *= huber / std::sqrt(chi2);
    }
    const double fu = camera.fx * iz, fv = camera.fy * iz;
    const double bu[3] = {fu * (r[0] - x * r[6]), fu * (r[1] - x * r[7]), fu * (r[2] - x * r[8])};
    const double bv[3] = {fv * (r[3] - y * r[6]), fv * (r[4] - y * r[7]), fv * (r[5] - y * r[8])};
    for (int c = 0; c < 3; ++c) {
      const double wu = weight * bu[c], wv = weight * bv[c];
      for (int k = 0; k < 3; ++k) hessian[3 * c + k] += wu * bu[k] + wv * bv[k];
      gradient[c] += wu * eu + wv * ev;
    }
    if (i >= point.free_count) continue;
    const double ju[6] = {fu, 0.0, -fu * x, -camera.fx * x * y, camera.fx * (1.0 + x * x), -camera.fx * y};
    const double jv[6] = {0.0, fv, -fv * y, -camera.fy * (1.0 + y * y), camera.fy * x * y, camera.fy * x};
    const Column cu = {V4{ju[0], ju[1], ju[2], ju[3]}, V4{ju[4], ju[5], 0.0, 0.0}};
    const Column cv = {V4{jv[0], jv[1], jv[2], jv[3]}, V4{jv[4], jv[5], 0.0, 0.0}};
    double* block = pose_hessian + static_cast<std::ptrdiff_t>(sight.free) * kPoseBlock;
    const auto add = [&](double su, double sv, double* to) {
      Column sum;
      Load(to, &sum);
      sum.low += su * cu.low + sv * cv.low;
      sum.high += su * cu.high + sv * cv.high;
      Store(sum, to);
    };
    for (int k = 0; k < 6; ++k) add(weight * ju[k], weight * jv[k], block + k * kPadded);
    add(weight * eu, weight * ev, pose_gradient + static_cast<std::ptrdiff_t>(sight.free) * kPadded);
    double* to = cross + static_cast<std::ptrdiff_t>(i) * kCrossBlock;
    for (int c = 0; c < 3; ++c) {
      const double su = weight * bu[c], sv = weight * bv[c];
      Store({su * cu.low + sv * cv.low, su * cu.high + sv * cv.high}, to + c * kPadded);
    }
  }
  std::memcpy(point_hessian, hessian, sizeof(hessian));
  std::memcpy(point_gradient, gradient, sizeof(gradient));
}

inline void EliminateBody(const SchurPoint& point, const double* inverse, const double* point_gradient,
                          const double* cross, double* reduced, double* right) {
  for (int i = 0; i < point.free_count; ++i) {
    const double* own = cross + static_cast<std::ptrdiff_t>(i) * kCrossBlock;
    Column c[3], e[3];  // cross_i, and cross_i inverse
    for (int k = 0; k < 3; ++k) Load(own + k * kPadded, &c[k]);
    for (int k = 0; k < 3; ++k) {
      const double* w = inverse + 3 * k;
      e[k].low = w[0] * c[0].low + w[1] * c[1].low + w[2] * c[2].low;
      e[k].high = w[0] * c[0].high + w[1] * c[1].high + w[2] * c[2].high;
    }
    const std::ptrdiff_t row = point.sights[i].free;
    Column sum;
    Load(right + row * kPadded, &sum);
    for (int k = 0; k < 3; ++k) {
      sum.low += point_gradient[k] * e[k].low;
      sum.high += point_gradient[k] * e[k].high;
    }
    Store(sum, right + row * kPadded);
    double* const blocks = reduced + row * (row + 1) / 2 * kPoseBlock;
    for (int j = 0; j <= i; ++j) {
      const double* other = cross + static_cast<std::ptrdiff_t>(j) * kCrossBlock;
      double* const block = blocks + static_cast<std::ptrdiff_t>(point.sights[j].free) * kPoseBlock;
      for (int k = 0; k < 6; ++k) {
        const double a = other[k], b = other[kPadded + k], d = other[2 * kPadded + k];
        Column to;
        Load(block + k * kPadded, &to);
        to.low -= a * e[0].low + b * e[1].low + d * e[2].low;
        to.high -= a * e[0].high + b * e[1].high + d * e[2].high;
        Store(to, block + k * kPadded);
      }
    }
  }
}

}  // namespace
}  // namespace cairn::optimization::internal

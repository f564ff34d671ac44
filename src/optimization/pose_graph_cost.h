// Cost function and manifold of the Sim(3) pose graph. Private to optimization.
//
// A block holds (qx qy qz qw tx ty tz log_scale) of camera_from_map. Steps are left increments in the order of
// geometry/se3.h: (translation, rotation, log scale). As in optimization/ceres_costs.h, derivatives by the step fill
// the first seven columns of the 7x8 Jacobians and the manifold's Jacobian is [I; 0].
#pragma once

#include <ceres/manifold.h>
#include <ceres/sized_cost_function.h>

#include "geometry/se3.h"

namespace cairn::optimization::internal {

// S Exp(x) S^-1 = Exp(SimilarityAdjoint(S) x).
Matrix7d SimilarityAdjoint(const Sim3& similarity);

// Exp(x + d) ~ Exp(J(x) d) Exp(x): the series sum ad(x)^n / (n + 1)!, which converges everywhere (Strasdat, PhD thesis,
// 2012, Sec. 2.4; the closed form has removable singularities in both angle and scale).
Matrix7d LeftJacobianSim3(const Vector7d& tangent);

void SimilarityToBlock(const Sim3& similarity, double* block);
Sim3 SimilarityFromBlock(const double* block);

class Sim3LeftIncrementManifold final : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 8; }
  int TangentSize() const override { return 7; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

// weight * Log(b_from_a * S_a * S_b^-1), its translation over `translation_unit`. Blocks: S_a, S_b. With the error
// E = b_from_a S_a S_b^-1 and e = Log(E): a step x of S_a turns it into Exp(Ad(b_from_a) x) E, one of S_b into
// E Exp(-x) = Exp(-Ad(E) x) E, so de = J_l(e)^-1 Ad(b_from_a) x and de = -J_l(e)^-1 Ad(E) x.
class RelativeSim3Cost final : public ceres::SizedCostFunction<7, 8, 8> {
 public:
  RelativeSim3Cost(const Sim3& b_from_a, double weight, double translation_unit);
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

 private:
  Sim3 b_from_a_;
  Matrix7d adjoint_;
  Vector7d weights_;
};

}  // namespace cairn::optimization::internal

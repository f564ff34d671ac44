#include "optimization/pose_graph_cost.h"

#include <Eigen/LU>
#include <cmath>

namespace cairn::optimization::internal {
namespace {

using Row78 = Eigen::Matrix<double, 7, 8, Eigen::RowMajor>;

// ad(x) y = [x, y] of the Lie algebra of Sim(3): with matrices [lambda I + [w]x, v; 0, 0], the commutator's translation
// is lambda_x v_y + w_x x v_y - lambda_y v_x - w_y x v_x.
Matrix7d SmallAdjoint(const Vector7d& x) {
  const Matrix3d w = Hat(x.segment<3>(3));
  Matrix7d ad = Matrix7d::Zero();
  ad.topLeftCorner<3, 3>() = w + x[6] * Matrix3d::Identity();
  ad.block<3, 3>(0, 3) = Hat(x.head<3>());
  ad.block<3, 1>(0, 6) = -x.head<3>();
  ad.block<3, 3>(3, 3) = w;
  return ad;
}

}  // namespace

Matrix7d SimilarityAdjoint(const Sim3& similarity) {
  const Matrix3d r = similarity.RotationMatrix();
  Matrix7d adjoint = Matrix7d::Zero();
  adjoint.topLeftCorner<3, 3>() = similarity.scale() * r;
  adjoint.block<3, 3>(0, 3) = Hat(similarity.translation()) * r;
  adjoint.block<3, 1>(0, 6) = -similarity.translation();
  adjoint.block<3, 3>(3, 3) = r;
  adjoint(6, 6) = 1.0;
  return adjoint;
}

Matrix7d LeftJacobianSim3(const Vector7d& tangent) {
  const Matrix7d ad = SmallAdjoint(tangent);
  Matrix7d sum = Matrix7d::Identity(), term = Matrix7d::Identity();
  constexpr int kMaxTerms = 60;
  for (int n = 1; n < kMaxTerms; ++n) {
    term = (ad * term / (n + 1.0)).eval();
    sum += term;
    if (term.cwiseAbs().maxCoeff() < 1e-17 * sum.cwiseAbs().maxCoeff()) break;
  }
  return sum;
}

void SimilarityToBlock(const Sim3& similarity, double* block) {
  Eigen::Map<Eigen::Matrix<double, 8, 1>> coordinates(block);
  coordinates << similarity.rotation().coeffs(), similarity.translation(), std::log(similarity.scale());
}

Sim3 SimilarityFromBlock(const double* block) {
  return {Quaterniond(Eigen::Map<const Eigen::Vector4d>(block)), Eigen::Map<const Vector3d>(block + 4),
          std::exp(block[7])};
}

bool Sim3LeftIncrementManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  SimilarityToBlock(Sim3::Exp(Eigen::Map<const Vector7d>(delta)) * SimilarityFromBlock(x), x_plus_delta);
  return true;
}

bool Sim3LeftIncrementManifold::PlusJacobian(const double*, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, 8, 7, Eigen::RowMajor>> j(jacobian);
  j.setZero();
  j.topRows<7>().setIdentity();
  return true;
}

bool Sim3LeftIncrementManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  Eigen::Map<Vector7d> difference(y_minus_x);
  difference = (SimilarityFromBlock(y) * SimilarityFromBlock(x).Inverse()).Log();
  return true;
}

bool Sim3LeftIncrementManifold::MinusJacobian(const double*, double* jacobian) const {
  Eigen::Map<Row78> j(jacobian);
  j.setZero();
  j.leftCols<7>().setIdentity();
  return true;
}

RelativeSim3Cost::RelativeSim3Cost(const Sim3& b_from_a, double weight, double translation_unit)
    : b_from_a_(b_from_a), adjoint_(SimilarityAdjoint(b_from_a)) {
  weights_.setConstant(weight);
  weights_.head<3>() /= translation_unit;
}

bool RelativeSim3Cost::Evaluate(double const* const* parameters, double* residuals, double** jacobians) const {
  const Sim3 error = b_from_a_ * SimilarityFromBlock(parameters[0]) * SimilarityFromBlock(parameters[1]).Inverse();
  const Vector7d tangent = error.Log();
  Eigen::Map<Vector7d> r(residuals);
  r = weights_.cwiseProduct(tangent);
  if (!r.allFinite()) return false;
  if (jacobians == nullptr) return true;
  const Matrix7d inverse = LeftJacobianSim3(tangent).inverse();
  if (jacobians[0] != nullptr) {
    Eigen::Map<Row78> j(jacobians[0]);
    j.setZero();
    j.leftCols<7>() = weights_.asDiagonal() * (inverse * adjoint_);
  }
  if (jacobians[1] != nullptr) {
    Eigen::Map<Row78> j(jacobians[1]);
    j.setZero();
    j.leftCols<7>() = -(weights_.asDiagonal() * (inverse * SimilarityAdjoint(error)));
  }
  return true;
}

}  // namespace cairn::optimization::internal

// The normal equations of 2D residuals that depend on up to seven parameters, summed up.
//
// A residual r with Jacobian J and weight w adds w J^T J to the Hessian and w J^T r to the gradient. Both are parts of
// the square of [J r], whose two rows are padded to eight numbers: a multiple of every width of registers, so that the
// sum of one residual takes few instructions whatever the number of parameters.
#pragma once

#include <Eigen/Core>

namespace cairn::optimization {

class NormalSum {
 public:
  using Row = Eigen::Matrix<double, 8, 1>;  // the derivatives of one coordinate, then zeros, and last its residual

  template <int kParameters>
  static Row RowOf(const Eigen::Matrix<double, 1, kParameters>& derivatives, double residual) {
    static_assert(kParameters <= 7);
    Row row = Row::Zero();
    row.head<kParameters>() = derivatives.transpose();
    row[7] = residual;
    return row;
  }

  void Add(double weight, const Row& u, const Row& v) {
    for (int column = 0; column < 8; ++column) {
      square_.col(column) += (weight * u[column]) * u + (weight * v[column]) * v;
    }
  }

  template <int kParameters>
  Eigen::Matrix<double, kParameters, kParameters> Hessian() const {
    return square_.topLeftCorner<kParameters, kParameters>();
  }
  template <int kParameters>
  Eigen::Matrix<double, kParameters, 1> Gradient() const {
    return square_.col(7).head<kParameters>();
  }

 private:
  Eigen::Matrix<double, 8, 8> square_ = Eigen::Matrix<double, 8, 8>::Zero();
};

}  // namespace cairn::optimization

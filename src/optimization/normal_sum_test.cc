#include "optimization/normal_sum.h"

#include <gtest/gtest.h>

#include "base/random.h"

namespace cairn::optimization {
namespace {

template <int kParameters>
void ExpectSumOfProducts() {
  Random random(kParameters);
  NormalSum sum;
  Eigen::Matrix<double, kParameters, kParameters> hessian = hessian.Zero();
  Eigen::Matrix<double, kParameters, 1> gradient = gradient.Zero();
  for (int i = 0; i < 20; ++i) {
    Eigen::Matrix<double, 2, kParameters> jacobian;
    for (double& value : jacobian.reshaped()) value = random.Uniform(-3.0, 3.0);
    const Eigen::Vector2d residual(random.Uniform(-1.0, 1.0), random.Uniform(-1.0, 1.0));
    const double weight = random.Uniform(0.0, 2.0);
    hessian += weight * jacobian.transpose() * jacobian;
    gradient += weight * jacobian.transpose() * residual;
    sum.Add(weight, NormalSum::RowOf<kParameters>(jacobian.row(0), residual.x()),
            NormalSum::RowOf<kParameters>(jacobian.row(1), residual.y()));
  }
  EXPECT_LT((sum.Hessian<kParameters>() - hessian).norm(), 1e-12 * hessian.norm());
  EXPECT_LT((sum.Gradient<kParameters>() - gradient).norm(), 1e-12 * gradient.norm());
}

TEST(NormalSum, IsTheSumOfProductsOfJacobians) {
  ExpectSumOfProducts<3>();
  ExpectSumOfProducts<6>();
  ExpectSumOfProducts<7>();
}

}  // namespace
}  // namespace cairn::optimization

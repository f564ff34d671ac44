// Marginalization: the second half of window.h.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "direct/window.h"

namespace cairn::direct {
namespace {

constexpr int kMinResidualsToSettle = 3;
constexpr int kMinGoodResidualsToSettle = 3;

}  // namespace

void Window::MarginalizePoints(const std::vector<bool>& keyframe_goes) {
  const int n = size(), unknowns = kFrameUnknowns * n;
  PreparePairs();
  Eigen::VectorXd row(unknowns);
  ResidualRow sums;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    ActivePoint& point = points_[i];
    int active = 0, good = 0, going = 0;
    for (int t = 0; t < n; ++t) {
      const ResidualState state = point.residuals[t].state;
      if (!HasResidual(state)) continue;
      ++active;
      if (state == ResidualState::kGood) ++good;
      if (state == ResidualState::kGood && keyframe_goes[t]) ++going;
    }
    const auto unseen = [&](int t) {
      const ResidualState state = point.residuals[t].state;
      return t != point.host && state != ResidualState::kGood && state != ResidualState::kCovered;
    };
    const bool host_goes = keyframe_goes[point.host];
    const bool left = point.host < n - 2 && unseen(n - 1) && unseen(n - 2);
    const bool thin = point.host < n - 1 && going > 0 && good - going < 2;
    if (good > 0 && !host_goes && !left && !thin) {
      if (kept != i) points_[kept] = point;
      ++kept;
      continue;
    }
    ++keyframes_[point.host]->points_gone;
    if (good < std::min(kMinResidualsToSettle, n - 1) || point.good_residuals < kMinGoodResidualsToSettle) continue;
    // The point's quadratic at the linearization point of the poses and its own current depth, its depth eliminated.
    row.setZero();
    double h_depth = 0.0, b_depth = 0.0;
    Eigen::MatrixXd& h = system().h;
    Eigen::VectorXd& b = system().b;
    h.setZero(unknowns, unknowns);
    b.setZero(unknowns);
    for (int t = 0; t < n; ++t) {
      if (point.residuals[t].state != ResidualState::kGood) continue;
      float energy;
      if (!Evaluate(point, t, point.inverse_depth, &energy, &sums)) continue;
      const Pair& p = pair(point.host, t);
      const Matrix8d full = sums.h.selfadjointView<Eigen::Upper>();
      const Vector8d b_linear = sums.b - full * p.relative_delta;
      const Matrix8d mapped = p.host_map.transpose() * full;
      const int at_host = kFrameUnknowns * point.host, at_target = kFrameUnknowns * t;
      h.block<8, 8>(at_target, at_target) += full;
      h.block<8, 8>(at_host, at_host) += mapped * p.host_map;
      h.block<8, 8>(at_host, at_target) += mapped;
      h.block<8, 8>(at_target, at_host) += mapped.transpose();
      b.segment<8>(at_target) += b_linear;
      b.segment<8>(at_host) += p.host_map.transpose() * b_linear;
      row.segment<8>(at_target) += sums.h_pose_depth;
      row.segment<8>(at_host) += p.host_map.transpose() * sums.h_pose_depth;
      h_depth += sums.h_depth;
      b_depth += sums.b_depth - sums.h_pose_depth.dot(p.relative_delta);
    }
    if (!(h_depth > options_.min_marginalization_hessian)) continue;
    h.noalias() -= (row / h_depth) * row.transpose();
    b.noalias() -= (b_depth / h_depth) * row;
    prior_h_ += h;
    prior_b_ += b;
    for (int t = 0; t < n; ++t) {
      if (t == point.host || point.residuals[t].state == ResidualState::kGood) keyframes_[t]->in_prior = true;
    }
    keyframes_[point.host]->settled.push_back({point.x, point.y, point.inverse_depth, static_cast<float>(h_depth)});
  }
  points_.resize(kept);
}

std::unique_ptr<Keyframe> Window::MarginalizeKeyframe(int index) {
  const int n = size(), rest = kFrameUnknowns * (n - 1), at = kFrameUnknowns * index;
  // The brightness prior of the keyframe goes with it.
  const Keyframe& going = *keyframes_[index];
  for (int i = 6; i < kFrameUnknowns; ++i) {
    const double linear = i == 6 ? going.linear_light.a : going.linear_light.b;
    prior_h_(at + i, at + i) += going.own_prior[i];
    prior_b_[at + i] += going.own_prior[i] * linear;
  }
  // Its unknowns move to the end.
  Eigen::PermutationMatrix<Eigen::Dynamic> order(kFrameUnknowns * n);
  for (int i = 0, to = 0; i < kFrameUnknowns * n; ++i) {
    const bool gone = i >= at && i < at + kFrameUnknowns;
    order.indices()[i] = gone ? rest + (i - at) : to++;
  }
  const Eigen::MatrixXd h = order * prior_h_ * order.transpose();
  const Eigen::VectorXd b = order * prior_b_;
  // Unit diagonal before inverting: the units of the unknowns differ by orders of magnitude.
  const Eigen::VectorXd scale = (h.diagonal().array().abs() + 10.0).sqrt().inverse();
  const Eigen::MatrixXd hs = scale.asDiagonal() * h * scale.asDiagonal();
  const Eigen::VectorXd bs = scale.cwiseProduct(b);
  const Eigen::MatrixXd cross = hs.topRightCorner(rest, kFrameUnknowns);
  Matrix8d corner = hs.bottomRightCorner<kFrameUnknowns, kFrameUnknowns>();
  corner.diagonal().array() += 1e-10;
  const Eigen::LDLT<Matrix8d> ldlt(corner);
  Eigen::MatrixXd reduced = hs.topLeftCorner(rest, rest) - cross * ldlt.solve(cross.transpose());
  const Vector8d solved = ldlt.solve(bs.tail<kFrameUnknowns>());
  const Eigen::VectorXd reduced_b = bs.head(rest) - cross * solved;
  const Eigen::VectorXd unscale = scale.head(rest).cwiseInverse();
  reduced = unscale.asDiagonal() * reduced * unscale.asDiagonal();
  prior_h_ = 0.5 * (reduced + reduced.transpose());
  prior_b_ = unscale.cwiseProduct(reduced_b);

  std::unique_ptr<Keyframe> keyframe = std::move(keyframes_[index]);
  keyframes_.erase(keyframes_.begin() + index);
  RemoveKeyframeFromPoints(index);
  PreparePairs();
  return keyframe;
}

void Window::RemoveKeyframeFromPoints(int index) {
  std::erase_if(points_, [&](const ActivePoint& point) { return point.host == index; });
  for (ActivePoint& point : points_) {
    std::copy(point.residuals.begin() + index + 1, point.residuals.end(), point.residuals.begin() + index);
    point.residuals.back() = PointResidual();
    if (point.host > index) --point.host;
  }
}

Window::DenseSystem Window::Linearize() {
  DenseSystem dense;
  dense.energy = LinearizeActive();
  const System& s = system();
  const Eigen::Index unknowns = s.h.rows(), count = static_cast<Eigen::Index>(points_.size());
  dense.h = Eigen::MatrixXd::Zero(unknowns + count, unknowns + count);
  dense.b = Eigen::VectorXd::Zero(unknowns + count);
  dense.gauge = GaugeTerm();
  dense.h.topLeftCorner(unknowns, unknowns) = s.h;
  dense.h.topRightCorner(unknowns, count) = s.rows;
  dense.h.bottomLeftCorner(count, unknowns) = s.rows.transpose();
  dense.b.head(unknowns) = s.b;
  for (Eigen::Index i = 0; i < count; ++i) {
    dense.h(unknowns + i, unknowns + i) = s.depth_h[i];
    dense.b[unknowns + i] = s.depth_b[i];
  }
  return dense;
}

Eigen::VectorXd Window::SchurStep(double damping) {
  LinearizeActive();
  Eigen::VectorXd step;
  std::vector<double> depth_steps;
  if (!SolveStep(damping, &step, &depth_steps)) return Eigen::VectorXd();
  Eigen::VectorXd all(step.size() + static_cast<Eigen::Index>(depth_steps.size()));
  all.head(step.size()) = step;
  for (std::size_t i = 0; i < depth_steps.size(); ++i) all[step.size() + static_cast<Eigen::Index>(i)] = depth_steps[i];
  return all;
}

}  // namespace cairn::direct

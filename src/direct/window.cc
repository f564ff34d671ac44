#include "direct/window.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "base/cpu_features.h"
#include "direct/point_tracer.h"

namespace cairn::direct {
namespace {

constexpr double kMinDepthHessian = 1e-3;

}  // namespace

Window::Window(const PyramidGeometry& geometry, const WindowOptions& options)
    : geometry_(geometry),
      options_(options),
      kernel_(ResidualKernelFor(ActiveSimdLevel())),
      pairs_(kMaxWindow * kMaxWindow) {
  keyframes_.reserve(kMaxWindow);
  Clear();
}

void Window::Clear() {
  keyframes_.clear();
  points_.clear();
  prior_h_ = Eigen::MatrixXd::Zero(0, 0);
  prior_b_ = Eigen::VectorXd::Zero(0);
}

Keyframe& Window::AddKeyframe(std::unique_ptr<Keyframe> keyframe) {
  keyframe->linear_camera_from_direct = keyframe->camera_from_direct;
  keyframe->linear_light = keyframe->light;
  keyframe->delta.setZero();
  const LightPrior prior = PriorOf(keyframe->data->frame, options_.affine_a_sigma, options_.affine_b_sigma_gray);
  keyframe->own_prior[6] = std::max(keyframe->own_prior[6], prior.a);
  keyframe->own_prior[7] = std::max(keyframe->own_prior[7], prior.b);
  keyframe->energy_limit = static_cast<float>(kPatternSize * options_.outlier_gray * options_.outlier_gray);
  keyframes_.push_back(std::move(keyframe));
  const int n = kFrameUnknowns * size();
  prior_h_.conservativeResize(n, n);
  prior_b_.conservativeResize(n);
  prior_h_.rightCols<kFrameUnknowns>().setZero();
  prior_h_.bottomRows<kFrameUnknowns>().setZero();
  prior_b_.tail<kFrameUnknowns>().setZero();
  PreparePairs();
  return *keyframes_.back();
}

void Window::ConnectNewest() {
  const int newest_index = size() - 1;
  for (ActivePoint& point : points_) {
    if (point.host != newest_index) point.residuals[newest_index] = {ResidualState::kGood, 0.0f};
  }
}

void Window::AddPoint(const ActivePoint& point) { points_.push_back(point); }

PairProjection Window::Projection(int host, int target) const {
  const Keyframe &h = *keyframes_[host], &t = *keyframes_[target];
  const double gain =
      ExposureRatio(t.data->frame.exposure_gain, h.data->frame.exposure_gain) * std::exp(t.light.a - h.light.a);
  return MakePairProjection(geometry_.camera[0], t.camera_from_direct * h.camera_from_direct.Inverse(), gain, t.light.b,
                            h.light.b);
}

void Window::PreparePairs() {
  for (int h = 0; h < size(); ++h) {
    for (int t = 0; t < size(); ++t) {
      if (h == t) continue;
      const Keyframe &host = *keyframes_[h], &target = *keyframes_[t];
      Pair& p = pair(h, t);
      p.projection = Projection(h, t);
      const SE3 linear = target.linear_camera_from_direct * host.linear_camera_from_direct.Inverse();
      p.linear_rotation = linear.RotationMatrix();
      p.linear_translation = linear.translation();
      const double linear_gain = ExposureRatio(target.data->frame.exposure_gain, host.data->frame.exposure_gain) *
                                 std::exp(target.linear_light.a - host.linear_light.a);
      p.projection.linear_gain = static_cast<float>(linear_gain);
      p.projection.linear_host_offset = static_cast<float>(host.linear_light.b);
      p.host_map.setZero();
      p.host_map.topLeftCorner<6, 6>() = -linear.Adjoint();
      p.host_map(6, 6) = -1.0;
      p.host_map(7, 7) = -linear_gain;
      p.relative_delta = target.delta + p.host_map * host.delta;
    }
  }
}

bool Window::Evaluate(const ActivePoint& point, int target, float inverse_depth, float* energy,
                      ResidualRow* row) const {
  const Pair& p = pair(point.host, target);
  const ImagePyramid& image = keyframes_[target]->data->pyramid;
  ResidualKernelInput input;
  input.x = point.x, input.y = point.y, input.inverse_depth = inverse_depth;
  input.color = point.color, input.weight = point.weight;
  input.pair = &p.projection;
  input.image = image.Level(0);
  input.width = image.Width(0), input.height = image.Height(0);
  input.huber = static_cast<float>(options_.huber_gray);
  ResidualSums s;
  kernel_(input, &s);
  if (!s.inside) return false;
  *energy = s.energy;
  if (row == nullptr) return true;

  const Pinhole& camera = geometry_.camera[0];
  const Vector3d moved = p.linear_rotation * Vector3d((point.x - camera.cx_px) / camera.fx_px,
                                                      (point.y - camera.cy_px) / camera.fy_px, 1.0) +
                         p.linear_translation * static_cast<double>(inverse_depth);
  const double iz = 1.0 / moved.z();
  const double x = moved.x() * iz, y = moved.y() * iz;
  const double fx = camera.fx_px, fy = camera.fy_px;
  const double nid = inverse_depth * iz;
  const double jx[6] = {fx * nid, 0.0, -fx * nid * x, -fx * x * y, fx * (1.0 + x * x), -fx * y};
  const double jy[6] = {0.0, fy * nid, -fy * nid * y, -fy * (1.0 + y * y), fy * x * y, fy * x};
  const double dx = fx * iz * (p.linear_translation.x() - p.linear_translation.z() * x);
  const double dy = fy * iz * (p.linear_translation.y() - p.linear_translation.z() * y);
  const double gdx = s.gxx * dx + s.gxy * dy, gdy = s.gxy * dx + s.gyy * dy;
  for (int i = 0; i < 6; ++i) {
    const double gx = s.gxx * jx[i] + s.gxy * jy[i], gy = s.gxy * jx[i] + s.gyy * jy[i];
    for (int k = i; k < 6; ++k) row->h(i, k) = gx * jx[k] + gy * jy[k];
    row->h(i, 6) = s.gxa * jx[i] + s.gya * jy[i];
    row->h(i, 7) = s.gxb * jx[i] + s.gyb * jy[i];
    row->b[i] = s.gxr * jx[i] + s.gyr * jy[i];
    row->h_pose_depth[i] = gdx * jx[i] + gdy * jy[i];
  }
  row->h(6, 6) = s.aa, row->h(6, 7) = s.ab, row->h(7, 7) = s.bb;
  row->b[6] = s.ar, row->b[7] = s.br;
  row->h_pose_depth[6] = s.gxa * dx + s.gya * dy;
  row->h_pose_depth[7] = s.gxb * dx + s.gyb * dy;
  row->h_depth = gdx * dx + gdy * dy;
  row->b_depth = s.gxr * dx + s.gyr * dy;
  return true;
}

double Window::LinearizeActive() {
  System& s = system();
  const int n = size(), unknowns = kFrameUnknowns * n;
  PreparePairs();
  for (int h = 0; h < n; ++h) {
    for (int t = 0; t < n; ++t) pair(h, t).h.setZero(), pair(h, t).b.setZero();
  }
  s.rows.resize(unknowns, static_cast<Eigen::Index>(points_.size()));
  s.depth_h.resize(points_.size());
  s.depth_b.resize(points_.size());
  double energy = 0.0;
  ResidualRow row;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    ActivePoint& point = points_[i];
    auto depth_row = s.rows.col(static_cast<Eigen::Index>(i));
    depth_row.setZero();
    Vector8d host_row = Vector8d::Zero();
    double h_depth = 0.0, b_depth = 0.0;
    for (int t = 0; t < n; ++t) {
      PointResidual& residual = point.residuals[t];
      if (!HasResidual(residual.state)) continue;
      const float limit = std::max(keyframes_[point.host]->energy_limit, keyframes_[t]->energy_limit);
      if (!Evaluate(point, t, point.inverse_depth, &residual.energy, &row)) {
        residual.state = ResidualState::kOutOfImage;
        residual.energy = limit;
        energy += limit;
        continue;
      }
      if (residual.energy > limit) {
        residual.state = ResidualState::kOutlier;
        energy += limit;
        continue;
      }
      residual.state = ResidualState::kGood;
      energy += residual.energy;
      Pair& p = pair(point.host, t);
      p.h += row.h;  // the upper triangle counts
      p.b += row.b;
      depth_row.segment<kFrameUnknowns>(kFrameUnknowns * t) = row.h_pose_depth;
      host_row += p.host_map.transpose() * row.h_pose_depth;
      h_depth += row.h_depth;
      b_depth += row.b_depth;
    }
    depth_row.segment<kFrameUnknowns>(kFrameUnknowns * point.host) = host_row;
    s.depth_h[i] = h_depth;
    s.depth_b[i] = b_depth;
    point.hessian = static_cast<float>(h_depth);
  }
  s.h.setZero(unknowns, unknowns);
  s.b.setZero(unknowns);
  for (int h = 0; h < n; ++h) {
    for (int t = 0; t < n; ++t) {
      if (h == t) continue;
      const Pair& p = pair(h, t);
      const Matrix8d full = p.h.selfadjointView<Eigen::Upper>();
      const Matrix8d mapped = p.host_map.transpose() * full;
      s.h.block<8, 8>(8 * t, 8 * t) += full;
      s.h.block<8, 8>(8 * h, 8 * h) += mapped * p.host_map;
      s.h.block<8, 8>(8 * h, 8 * t) += mapped;
      s.h.block<8, 8>(8 * t, 8 * h) += mapped.transpose();
      s.b.segment<8>(8 * t) += p.b;
      s.b.segment<8>(8 * h) += p.host_map.transpose() * p.b;
    }
  }
  AddPriors(&s.h, &s.b);
  return energy + PriorEnergy();
}

// The marginalization prior and those of the brightness, both as quadratics of the distance from the linearization
// point.
void Window::AddPriors(Eigen::MatrixXd* h, Eigen::VectorXd* b) const {
  const int n = size();
  Eigen::VectorXd delta(kFrameUnknowns * n);
  for (int k = 0; k < n; ++k) delta.segment<kFrameUnknowns>(kFrameUnknowns * k) = keyframes_[k]->delta;
  *h += prior_h_;
  *b += prior_b_ + prior_h_ * delta;
  for (int k = 0; k < n; ++k) {
    const Keyframe& keyframe = *keyframes_[k];
    for (int i = 0; i < 2; ++i) {
      const int at = kFrameUnknowns * k + 6 + i;
      const double value = i == 0 ? keyframe.light.a : keyframe.light.b;
      (*h)(at, at) += keyframe.own_prior[6 + i];
      (*b)[at] += keyframe.own_prior[6 + i] * value;
    }
  }
}

double Window::PriorEnergy() const {
  const int n = size();
  Eigen::VectorXd delta(kFrameUnknowns * n);
  double energy = 0.0;
  for (int k = 0; k < n; ++k) {
    const Keyframe& keyframe = *keyframes_[k];
    delta.segment<kFrameUnknowns>(kFrameUnknowns * k) = keyframe.delta;
    energy += keyframe.own_prior[6] * keyframe.light.a * keyframe.light.a +
              keyframe.own_prior[7] * keyframe.light.b * keyframe.light.b;
  }
  return energy + delta.dot(prior_h_ * delta) + 2.0 * prior_b_.dot(delta);
}

// Orthonormal directions in which the old keyframes would move if the world turned, shifted or scaled as a whole: the
// step is kept at zero along them, so that the new keyframes move and not the world.
Eigen::MatrixXd Window::GaugeBasis() const {
  const int n = size();
  bool any_in_prior = false;
  for (const auto& keyframe : keyframes_) any_in_prior |= keyframe->in_prior;
  Eigen::MatrixXd basis = Eigen::MatrixXd::Zero(kFrameUnknowns * n, 7);
  for (int k = 0; k < n; ++k) {
    const Keyframe& keyframe = *keyframes_[k];
    const bool anchor = any_in_prior ? keyframe.in_prior : (k < 2 || k + 1 < n);
    if (!anchor) continue;
    basis.block<6, 6>(kFrameUnknowns * k, 0) = keyframe.linear_camera_from_direct.Adjoint();
    basis.block<3, 1>(kFrameUnknowns * k, 6) = keyframe.linear_camera_from_direct.translation();
  }
  // Modified Gram-Schmidt, twice is not needed for seven columns; a direction without extent is left out.
  for (int c = 0; c < 7; ++c) {
    const double before = basis.col(c).norm();
    for (int k = 0; k < c; ++k) basis.col(c) -= basis.col(k).dot(basis.col(c)) * basis.col(k);
    const double after = basis.col(c).norm();
    if (after > 1e-6 * std::max(before, 1e-12) && after > 1e-9) {
      basis.col(c) /= after;
    } else {
      basis.col(c).setZero();
    }
  }
  return basis;
}

Eigen::MatrixXd Window::GaugeTerm() const {
  const Eigen::MatrixXd basis = GaugeBasis();
  const Eigen::VectorXd diagonal = system().h.diagonal();
  return (diagonal.head(std::min<Eigen::Index>(6, diagonal.size())).mean() + 1.0) * basis * basis.transpose();
}

bool Window::SolveStep(double damping, Eigen::VectorXd* step, std::vector<double>* depth_steps) {
  System& s = system();
  const Eigen::Index unknowns = s.h.rows();
  Eigen::MatrixXd h = s.h;
  Eigen::VectorXd b = s.b;
  h.diagonal() *= 1.0 + damping;
  scaled_rows_.resize(unknowns, s.rows.cols());
  for (Eigen::Index i = 0; i < s.rows.cols(); ++i) {
    const double hd = s.depth_h[i] * (1.0 + damping);
    const double scale = hd > kMinDepthHessian ? 1.0 / std::sqrt(hd) : 0.0;
    scaled_rows_.col(i) = scale * s.rows.col(i);
    b.noalias() -= (scale * scale * s.depth_b[i]) * s.rows.col(i);
  }
  h.selfadjointView<Eigen::Lower>().rankUpdate(scaled_rows_, -1.0);
  h.triangularView<Eigen::StrictlyUpper>() = h.transpose();
  // Unit diagonal for conditioning; the gauge directions get a weight of that order.
  const Eigen::VectorXd scale = (s.h.diagonal().array() + 10.0).sqrt().inverse();
  h += GaugeTerm();
  h = scale.asDiagonal() * h * scale.asDiagonal();
  const Eigen::VectorXd scaled_b = scale.cwiseProduct(b);
  const Eigen::LDLT<Eigen::MatrixXd> ldlt(h);
  if (ldlt.info() != Eigen::Success) return false;
  *step = -scale.cwiseProduct(ldlt.solve(scaled_b));
  if (!step->allFinite()) return false;
  depth_steps->resize(points_.size());
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const double hd = s.depth_h[i] * (1.0 + damping);
    (*depth_steps)[i] =
        hd > kMinDepthHessian ? -(s.depth_b[i] + s.rows.col(static_cast<Eigen::Index>(i)).dot(*step)) / hd : 0.0;
  }
  return true;
}

void Window::ApplyStep(const Eigen::VectorXd& step, const std::vector<double>& depth_steps) {
  for (int k = 0; k < size(); ++k) {
    Keyframe& keyframe = *keyframes_[k];
    keyframe.delta += step.segment<kFrameUnknowns>(kFrameUnknowns * k);
    keyframe.camera_from_direct = SE3::Exp(keyframe.delta.head<6>()) * keyframe.linear_camera_from_direct;
    keyframe.light = {keyframe.linear_light.a + keyframe.delta[6], keyframe.linear_light.b + keyframe.delta[7]};
  }
  for (std::size_t i = 0; i < points_.size(); ++i) {
    points_[i].inverse_depth = std::max(points_[i].inverse_depth + static_cast<float>(depth_steps[i]), 1e-5f);
  }
}

// Keyframes that the prior does not know yet are linearized where they are.
void Window::Relinearize() {
  for (const auto& keyframe : keyframes_) {
    if (keyframe->in_prior) continue;
    keyframe->linear_camera_from_direct = keyframe->camera_from_direct;
    keyframe->linear_light = keyframe->light;
    keyframe->delta.setZero();
  }
}

OptimizationReport Window::Optimize(int max_iterations) {
  OptimizationReport report;
  if (size() < 2 || points_.empty()) return report;
  Relinearize();
  PreparePairs();
  for (ActivePoint& point : points_) {
    PointResidual& residual = point.residuals[size() - 1];
    if (!HasResidual(residual.state)) continue;
    residual.state = Evaluate(point, size() - 1, point.inverse_depth, &residual.energy, nullptr)
                         ? ResidualState::kGood
                         : ResidualState::kOutOfImage;
  }
  SetEnergyLimit(size() - 1);
  double energy = LinearizeActive();
  double damping = 1e-5;
  Eigen::VectorXd step;
  std::vector<double> depth_steps;
  struct Backup {
    SE3 pose, linear_pose;
    AffineLight light, linear_light;
    Vector8d delta;
  };
  std::vector<Backup> frames(size());
  std::vector<float> depths(points_.size());
  std::vector<std::array<PointResidual, kMaxWindow>> residuals(points_.size());
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    if (!SolveStep(damping, &step, &depth_steps)) break;
    for (int k = 0; k < size(); ++k) {
      const Keyframe& keyframe = *keyframes_[k];
      frames[k] = {keyframe.camera_from_direct, keyframe.linear_camera_from_direct, keyframe.light,
                   keyframe.linear_light, keyframe.delta};
    }
    for (std::size_t i = 0; i < points_.size(); ++i) {
      depths[i] = points_[i].inverse_depth;
      residuals[i] = points_[i].residuals;
    }
    ApplyStep(step, depth_steps);
    Relinearize();
    current_system_ ^= 1;
    const double next = LinearizeActive();
    ++report.iterations;
    if (next < energy) {
      const bool small = energy - next < 1e-5 * energy;
      energy = next;
      damping = std::max(damping * 0.25, 1e-7);
      if (small) break;
    } else {
      for (int k = 0; k < size(); ++k) {
        Keyframe& keyframe = *keyframes_[k];
        keyframe.camera_from_direct = frames[k].pose, keyframe.linear_camera_from_direct = frames[k].linear_pose;
        keyframe.light = frames[k].light, keyframe.linear_light = frames[k].linear_light;
        keyframe.delta = frames[k].delta;
      }
      for (std::size_t i = 0; i < points_.size(); ++i) {
        points_[i].inverse_depth = depths[i];
        points_[i].residuals = residuals[i];
      }
      current_system_ ^= 1;
      damping = std::max(damping * 100.0, 1e-3);
      if (damping > 1e4) break;
    }
  }
  UpdateEnergyLimits();
  double sum = 0.0;
  for (ActivePoint& point : points_) {
    for (int t = 0; t < size(); ++t) {
      if (point.residuals[t].state != ResidualState::kGood) continue;
      sum += point.residuals[t].energy;
      ++report.residuals;
    }
  }
  report.rms_gray = report.residuals > 0 ? std::sqrt(sum / (report.residuals * kPatternSize)) : 0.0;
  return report;
}

void Window::UpdateEnergyLimits() {
  for (int t = 0; t < size(); ++t) SetEnergyLimit(t);
}

// The limit of a keyframe follows the median of the residuals in it.
void Window::SetEnergyLimit(int target) {
  energies_.clear();
  for (const ActivePoint& point : points_) {
    const ResidualState state = point.residuals[target].state;
    if (state == ResidualState::kGood || state == ResidualState::kOutlier)
      energies_.push_back(point.residuals[target].energy);
  }
  const double base = kPatternSize * options_.outlier_gray * options_.outlier_gray;
  float& limit = keyframes_[target]->energy_limit;
  limit = static_cast<float>(base);
  if (energies_.size() < 20) return;
  const auto middle = energies_.begin() + static_cast<std::ptrdiff_t>(energies_.size() / 2);
  std::nth_element(energies_.begin(), middle, energies_.end());
  const double factor = options_.outlier_median_factor;
  limit = static_cast<float>(std::clamp(factor * factor * *middle, 0.5 * base, 4.0 * base));
}

bool Window::RefineCandidate(const ImmaturePoint& candidate, int host, double min_hessian, int min_good,
                             ActivePoint* point) {
  *point = ActivePoint();
  point->x = candidate.x, point->y = candidate.y, point->host = host;
  std::copy(candidate.color, candidate.color + kPatternSize, point->color);
  std::copy(candidate.weight, candidate.weight + kPatternSize, point->weight);
  float inverse_depth = 0.5f * (candidate.min_inverse_depth + candidate.max_inverse_depth);
  const auto evaluate = [&](float at, double* h, double* b, int* good) {
    double energy = 0.0;
    *h = *b = 0.0, *good = 0;
    ResidualRow row;
    for (int t = 0; t < size(); ++t) {
      if (t == host) continue;
      float e;
      const float limit = std::max(keyframes_[host]->energy_limit, keyframes_[t]->energy_limit);
      if (!Evaluate(*point, t, at, &e, &row)) {
        point->residuals[t] = {ResidualState::kOutOfImage, limit};
        energy += limit;
      } else if (e > limit) {
        point->residuals[t] = {ResidualState::kOutlier, e};
        energy += limit;
      } else {
        point->residuals[t] = {ResidualState::kGood, e};
        energy += e, *h += row.h_depth, *b += row.b_depth, ++*good;
      }
    }
    return energy;
  };
  double h, b, damping = 0.1;
  int good;
  double energy = evaluate(inverse_depth, &h, &b, &good);
  for (int iteration = 0; iteration < 5; ++iteration) {
    if (good < min_good || h < min_hessian * 0.1) return false;
    const float next = inverse_depth - static_cast<float>(b / (h * (1.0 + damping)));
    double next_h, next_b;
    int next_good;
    const double next_energy = evaluate(next, &next_h, &next_b, &next_good);
    const bool small = std::abs(next - inverse_depth) < 1e-3f * std::abs(inverse_depth);
    if (next_energy < energy && std::isfinite(next)) {
      inverse_depth = next, energy = next_energy, h = next_h, b = next_b, good = next_good;
      damping *= 0.5;
    } else {
      damping *= 5.0;
    }
    if (small) break;
  }
  evaluate(inverse_depth, &h, &b, &good);
  if (good < min_good || h < min_hessian || !(inverse_depth > 1e-4f)) return false;
  point->inverse_depth = inverse_depth;
  point->hessian = static_cast<float>(h);
  point->good_residuals = good;
  for (PointResidual& residual : point->residuals) {
    if (residual.state == ResidualState::kOutlier) residual.state = ResidualState::kNone;
  }
  return true;
}

}  // namespace cairn::direct

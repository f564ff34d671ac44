#include "direct/coarse_tracker.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "base/cpu_features.h"

namespace cairn::direct {
namespace {

constexpr int kIterations[kMaxLevels] = {10, 20, 50, 50, 50, 50, 50, 50};
constexpr double kInitialDamping = 0.01;
constexpr double kSmallStep = 1e-4;          // of level 0, rad and baseline in units of the scene
constexpr double kResidualSigmaGray = 10.0;  // of a residual, beside the prior of the motion
constexpr int kMaxRejected = 3;              // in a row
constexpr double kMaxSaturatedShare = 0.6;   // beyond it the cutoff is doubled
constexpr int kMaxCutoffDoublings = 6;
constexpr float kFarOut = -1e6f;  // padding pixel, never inside an image
// Units of the increment for the step size and for conditioning: rad and baseline, log gain, gray levels.
constexpr double kStepScale[kTrackingUnknowns] = {0.5, 0.5, 0.5, 1.0, 1.0, 1.0, 10.0, 1000.0};

struct LevelSystem {
  TrackingKernelSums sums;
  double rms = 0.0;                                                          // sqrt of mean energy
  double cost = 0.0;                                                         // the same with the priors
  Eigen::Matrix<double, 6, 1> motion = Eigen::Matrix<double, 6, 1>::Zero();  // from the guess
};

}  // namespace

CoarseTracker::CoarseTracker(const PyramidGeometry& geometry, double huber_gray, double cutoff_gray)
    : geometry_(geometry),
      huber_(static_cast<float>(huber_gray)),
      cutoff_(static_cast<float>(cutoff_gray)),
      kernel_(TrackingKernelFor(ActiveSimdLevel())) {
  for (int level = 0; level < geometry_.levels; ++level) {
    const std::size_t pixels =
        static_cast<std::size_t>(geometry_.camera[level].width_px) * geometry_.camera[level].height_px;
    depth_[level].resize(pixels);
    weight_[level].resize(pixels);
  }
  weight_copy_.resize(weight_[0].size());
}

void PadLevel(TrackingReference::Level* level) {
  level->count = static_cast<int>(level->x.size());
  while (level->x.size() % 8 != 0) {
    level->x.push_back(kFarOut), level->y.push_back(kFarOut);
    level->inverse_depth.push_back(1.0f), level->color.push_back(0.0f);
  }
}

void CoarseTracker::BuildReference(const ImagePyramid& image, const std::vector<ReferencePoint>& points,
                                   TrackingReference* reference) {
  std::fill(depth_[0].begin(), depth_[0].end(), 0.0f);
  std::fill(weight_[0].begin(), weight_[0].end(), 0.0f);
  const int width0 = geometry_.camera[0].width_px, height0 = geometry_.camera[0].height_px;
  for (const ReferencePoint& point : points) {
    const int x = static_cast<int>(point.x + 0.5f), y = static_cast<int>(point.y + 0.5f);
    if (x < 0 || y < 0 || x >= width0 || y >= height0) continue;
    const std::size_t at = static_cast<std::size_t>(y) * width0 + x;
    depth_[0][at] += point.inverse_depth * point.weight;
    weight_[0][at] += point.weight;
  }
  for (int level = 1; level < geometry_.levels; ++level) {
    const int width = geometry_.camera[level].width_px, height = geometry_.camera[level].height_px;
    const int finer_width = geometry_.camera[level - 1].width_px;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const std::size_t a = static_cast<std::size_t>(2 * y) * finer_width + 2 * x, b = a + finer_width;
        const std::size_t at = static_cast<std::size_t>(y) * width + x;
        const std::vector<float>&d = depth_[level - 1], &w = weight_[level - 1];
        depth_[level][at] = d[a] + d[a + 1] + d[b] + d[b + 1];
        weight_[level][at] = w[a] + w[a + 1] + w[b] + w[b + 1];
      }
    }
  }
  for (int level = 0; level < geometry_.levels; ++level) {
    const int width = geometry_.camera[level].width_px, height = geometry_.camera[level].height_px;
    std::vector<float>&d = depth_[level], &w = weight_[level];
    // Empty pixels take the sum of their neighbours: diagonal on the two finest levels, direct above.
    std::copy(w.begin(), w.end(), weight_copy_.begin());
    const int diagonal[4] = {width + 1, width - 1, -width - 1, -width + 1};
    const int direct[4] = {1, -1, width, -width};
    const int* neighbours = level < 2 ? diagonal : direct;
    for (int y = 1; y + 1 < height; ++y) {
      for (int x = 1; x + 1 < width; ++x) {
        const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y) * width + x;
        if (weight_copy_[at] > 0.0f) continue;
        float sum = 0.0f, total = 0.0f, count = 0.0f;
        for (int k = 0; k < 4; ++k) {
          const std::ptrdiff_t n = at + neighbours[k];
          if (weight_copy_[n] > 0.0f) sum += d[n], total += weight_copy_[n], count += 1.0f;
        }
        if (count > 0.0f) d[at] = sum / count, w[at] = total / count;
      }
    }
    TrackingReference::Level& out = reference->level[level];
    out.x.clear(), out.y.clear(), out.inverse_depth.clear(), out.color.clear();
    for (int y = 2; y + 3 < height; ++y) {
      for (int x = 2; x + 3 < width; ++x) {
        const std::size_t at = static_cast<std::size_t>(y) * width + x;
        if (w[at] <= 0.0f) continue;
        const float inverse_depth = d[at] / w[at];
        if (!(inverse_depth > 0.0f)) continue;
        out.x.push_back(static_cast<float>(x));
        out.y.push_back(static_cast<float>(y));
        out.inverse_depth.push_back(inverse_depth);
        out.color.push_back(image.At(level, x, y)[0] - static_cast<float>(reference->light.b));
      }
    }
    PadLevel(&out);
    if (level == 0 && out.count > 0) {
      double sum = 0.0;
      for (int i = 0; i < out.count; ++i) sum += out.inverse_depth[static_cast<std::size_t>(i)];
      reference->mean_inverse_depth = sum / out.count;
    }
  }
}

TrackingOutcome CoarseTracker::Align(const TrackingReference& reference, const FrameData& data,
                                     const MotionGuess& guess, const AffineLight& light, const LightPrior& prior,
                                     const double* give_up_rms, double* level_rms) const {
  const ImagePyramid& image = data.pyramid;
  TrackingOutcome outcome;
  SE3 pose = guess.new_from_reference;
  const SE3 reference_from_guess = pose.Inverse();
  Eigen::Matrix<double, 6, 1> motion_weight = Eigen::Matrix<double, 6, 1>::Zero();
  if (guess.sigma_px > 0.0) {
    const double rotation = kResidualSigmaGray * geometry_.camera[0].fx_px / guess.sigma_px;
    const double translation = rotation * reference.mean_inverse_depth;
    motion_weight << Vector3d::Constant(translation * translation), Vector3d::Constant(rotation * rotation);
  }
  AffineLight current = light;
  const double exposure_ratio = ExposureRatio(data.frame.exposure_gain, reference.exposure_gain);
  for (int level = geometry_.levels - 1; level >= 0; --level) {
    const TrackingReference::Level& points = reference.level[level];
    const Pinhole& camera = geometry_.camera[level];
    TrackingKernelInput input;
    input.x = points.x.data(), input.y = points.y.data();
    input.inverse_depth = points.inverse_depth.data(), input.color = points.color.data();
    input.count = static_cast<int>(points.x.size());
    input.image = image.Level(level);
    input.width = camera.width_px, input.height = camera.height_px;
    input.fx = static_cast<float>(camera.fx_px), input.fy = static_cast<float>(camera.fy_px);
    input.cx = static_cast<float>(camera.cx_px), input.cy = static_cast<float>(camera.cy_px);
    input.huber = huber_, input.cutoff = cutoff_;
    Matrix3d inverse_k;
    inverse_k << 1.0 / camera.fx_px, 0.0, -camera.cx_px / camera.fx_px, 0.0, 1.0 / camera.fy_px,
        -camera.cy_px / camera.fy_px, 0.0, 0.0, 1.0;
    const auto evaluate = [&](const SE3& at, const AffineLight& at_light) {
      const Eigen::Matrix<float, 3, 3, Eigen::RowMajor> rays = (at.RotationMatrix() * inverse_k).cast<float>();
      std::copy(rays.data(), rays.data() + 9, input.rotation_rays);
      for (int k = 0; k < 3; ++k) input.translation[k] = static_cast<float>(at.translation()[k]);
      input.gain = static_cast<float>(exposure_ratio * std::exp(at_light.a - reference.light.a));
      input.offset = static_cast<float>(at_light.b);
      LevelSystem system;
      kernel_(input, &system.sums);
      const float visible = static_cast<float>(system.sums.visible);
      system.motion = (at * reference_from_guess).Log();
      const double motion_energy = motion_weight.dot(system.motion.cwiseAbs2());
      const float with_prior = system.sums.energy + static_cast<float>(prior.Energy(at_light) + motion_energy);
      system.rms = visible > 0.0f ? std::sqrt(system.sums.energy / visible) : 1e9;
      system.cost = visible > 0.0f ? std::sqrt(with_prior / visible) : 1e9;
      return system;
    };
    LevelSystem system = evaluate(pose, current);
    for (int k = 0; k < kMaxCutoffDoublings && system.sums.saturated > kMaxSaturatedShare * system.sums.visible; ++k) {
      input.cutoff *= 2.0f;
      system = evaluate(pose, current);
    }
    double damping = kInitialDamping;
    int rejected = 0;
    for (int iteration = 0; iteration < kIterations[level]; ++iteration) {
      Eigen::Matrix<double, 8, 8> h;
      Eigen::Matrix<double, 8, 1> b;
      for (int r = 0; r < 8; ++r) {
        b[r] = system.sums.b[r] * kStepScale[r];
        for (int c = 0; c < 8; ++c) h(r, c) = system.sums.h[8 * r + c] * kStepScale[r] * kStepScale[c];
      }
      for (int r = 0; r < 6; ++r) {
        b[r] += motion_weight[r] * system.motion[r] * kStepScale[r];
        h(r, r) += motion_weight[r] * kStepScale[r] * kStepScale[r];
      }
      b[6] += prior.a * current.a * kStepScale[6];
      b[7] += prior.b * current.b * kStepScale[7];
      h(6, 6) += prior.a * kStepScale[6] * kStepScale[6];
      h(7, 7) += prior.b * kStepScale[7] * kStepScale[7];
      for (int r = 0; r < 8; ++r) h(r, r) = h(r, r) * (1.0 + damping) + 1e-9;
      Eigen::Matrix<double, 8, 1> step = -h.ldlt().solve(b);
      for (int r = 0; r < 8; ++r) step[r] *= kStepScale[r];
      if (!step.allFinite()) break;
      const SE3 next_pose = SE3::Exp(step.head<6>()) * pose;
      const AffineLight next_light{current.a + step[6], current.b + step[7]};
      const LevelSystem next = evaluate(next_pose, next_light);
      // Fewer visible points must not look like an improvement.
      const bool better = next.sums.visible > 0 && next.cost < system.cost;
      if (better) {
        pose = next_pose, current = next_light, system = next;
        damping *= 0.5;
      } else {
        damping = std::max(damping * 4.0, kInitialDamping);
      }
      // A coarse level need not be more precise than its pixels.
      const double length = step.head<6>().norm(), enough = kSmallStep * (1 << level);
      rejected = better ? 0 : rejected + 1;
      if (length < enough || rejected >= kMaxRejected) break;
    }
    // A level that needed a larger cutoff is judged, like the others, at the usual one.
    if (input.cutoff > cutoff_) {
      input.cutoff = cutoff_;
      system = evaluate(pose, current);
    }
    level_rms[level] = system.rms;
    if (points.count > 0 && give_up_rms[level] > 0.0 && system.rms > give_up_rms[level]) return outcome;
    if (level == 0) {
      outcome.rms_gray = system.rms;
      const double count = std::max(1, points.count);
      outcome.visible_share = system.sums.visible / count;
      outcome.good_share = (system.sums.visible - system.sums.saturated) / count;
      outcome.weakest_sigma_px = WeakestSigmaPx(system.sums.h, reference.mean_inverse_depth);
    }
  }
  outcome.new_from_reference = pose;
  outcome.light = current;
  outcome.converged = pose.translation().allFinite() && reference.level[0].count > 0;
  Flow(reference, &outcome);
  return outcome;
}

double CoarseTracker::WeakestSigmaPx(const float* h, double mean_inverse_depth) const {
  // In pixels: rotation, and translation at the reference's mean depth; the light eliminated.
  const double fx_px = geometry_.camera[0].fx_px;
  const Eigen::Matrix<double, 8, 8> all = Eigen::Map<const Eigen::Matrix<float, 8, 8>>(h).cast<double>();
  Eigen::Matrix2d light = all.bottomRightCorner<2, 2>();
  light.diagonal() *= 1.0 + 1e-9;
  light.diagonal().array() += 1e-9;
  Eigen::Matrix<double, 6, 6> pose = all.topLeftCorner<6, 6>();
  pose -= all.topRightCorner<6, 2>() * light.inverse() * all.bottomLeftCorner<2, 6>();
  Eigen::Matrix<double, 6, 1> per_px;
  per_px.head<3>().setConstant(1.0 / (fx_px * mean_inverse_depth));
  per_px.tail<3>().setConstant(1.0 / fx_px);
  pose = per_px.asDiagonal() * pose * per_px.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> eigen(pose, Eigen::EigenvaluesOnly);
  return kResidualSigmaGray / std::sqrt(std::max(eigen.eigenvalues()[0], 1e-6));
}

void CoarseTracker::Flow(const TrackingReference& reference, TrackingOutcome* outcome) const {
  const TrackingReference::Level& points = reference.level[0];
  const Pinhole& camera = geometry_.camera[0];
  const Matrix3d rotation = outcome->new_from_reference.RotationMatrix();
  const Vector3d translation = outcome->new_from_reference.translation();
  double full = 0.0, translational = 0.0;
  int count = 0;
  const int stride = std::max(1, points.count / 500);
  for (int i = 0; i < points.count; i += stride) {
    const Vector2d pixel(points.x[i], points.y[i]);
    const Vector3d ray = camera.Unproject(pixel);
    const Vector3d shift = translation * static_cast<double>(points.inverse_depth[i]);
    const Vector3d shifted = ray + shift, moved = rotation * ray + shift;
    if (shifted.z() < 1e-3 || moved.z() < 1e-3) continue;
    translational += (camera.Project(shifted) - pixel).squaredNorm();
    full += (camera.Project(moved) - pixel).squaredNorm();
    ++count;
  }
  outcome->flow_px = count > 0 ? std::sqrt(full / count) : 0.0;
  outcome->translation_flow_px = count > 0 ? std::sqrt(translational / count) : 0.0;
}

}  // namespace cairn::direct

#include "optimization/photometric_adjustment.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/str_cat.h"

namespace cairn::optimization {
namespace {

constexpr int kModelUnknowns = kPhotometricUnknowns;
constexpr int kMinPoints = 50;
constexpr double kMinVignette = 0.05;
constexpr double kMaxPhotometricDamping = 1e8;

struct State {
  PhotometricModel model;
  Eigen::VectorXd log_exposure;  // per frame
  Eigen::VectorXd log_radiance;  // per point, kappa included
};

class Problem {
 public:
  Problem(std::vector<PhotometricObservation> observations, int frames, int points, bool known,
          const PhotometricAdjustmentOptions& options)
      : observations_(std::move(observations)),
        frames_(frames),
        points_(points),
        known_(known),
        options_(options),
        unknowns_(kModelUnknowns + (known ? 0 : frames)) {}

  double Cost(const State& state) const {
    if (!Valid(state.model)) return std::numeric_limits<double>::infinity();
    const PhotometricPredictor predictor(state.model);
    double cost = PriorCost(state);
    for (const PhotometricObservation& o : observations_) {
      cost +=
          Loss((predictor.Intensity(state.log_radiance[o.point], state.log_exposure[o.frame], o.radius) - o.intensity) /
               o.sigma_gray);
    }
    return cost;
  }

  // The normal equations with the radiances eliminated. Observations are sorted by point.
  void Linearize(const State& state, double damping) {
    const PhotometricPredictor predictor(state.model);
    h_.setZero(unknowns_, unknowns_);
    b_.setZero(unknowns_);
    rows_.clear();
    row_begin_.assign(1, 0);
    h_point_.assign(points_, 0.0);
    b_point_.assign(points_, 0.0);
    model_rows_.resize(points_);
    std::size_t i = 0;
    for (int point = 0; point < points_; ++point) {
      PhotometricVector model_row = PhotometricVector::Zero();
      for (; i < observations_.size() && observations_[i].point == point; ++i) {
        Accumulate(state, predictor, observations_[i], &model_row);
      }
      model_rows_[point] = model_row;
      row_begin_.push_back(rows_.size());
    }
    AddPriors(state);
    h_.triangularView<Eigen::StrictlyUpper>() = h_.transpose();
    reduced_h_ = h_;
    reduced_h_.diagonal() += damping * h_.diagonal();
    reduced_b_ = b_;
    Eliminate(damping);
  }

  bool Step(double damping, const State& from, State* to) const {
    const Eigen::LDLT<Eigen::MatrixXd> ldlt(reduced_h_);
    if (ldlt.info() != Eigen::Success) return false;
    const Eigen::VectorXd step = -ldlt.solve(reduced_b_);
    if (!step.allFinite()) return false;
    *to = from;
    to->model.kappa += step[0];
    for (int k = 0; k < kResponseTerms; ++k) to->model.response[k] += step[1 + k];
    for (int k = 0; k < kVignetteTerms; ++k) to->model.vignette[k] += step[kVignetteAt + k];
    if (!known_) to->log_exposure += step.tail(frames_);
    for (int point = 0; point < points_; ++point) {
      double b = b_point_[point] + model_rows_[point].dot(step.head<kModelUnknowns>());
      for (std::size_t k = row_begin_[point]; k < row_begin_[point + 1]; ++k) {
        b += rows_[k].value * step[kModelUnknowns + rows_[k].frame];
      }
      const double h = h_point_[point] * (1.0 + damping);
      if (h > 0.0) to->log_radiance[point] -= b / h;
    }
    if (!known_) {  // a factor common to all exposures is the radiances'
      const double mean = to->log_exposure.mean();
      to->log_exposure.array() -= mean;
      to->log_radiance.array() += to->model.kappa * mean;
    }
    return true;
  }

  // Of kappa, c and v, everything else marginalized; whitened residuals of unit variance are assumed. Nothing is
  // uncertain along `fixed`.
  Eigen::MatrixXd ModelCovariance(const PhotometricVector& fixed) const {
    Eigen::MatrixXd h = reduced_h_;
    h.topLeftCorner<kModelUnknowns, kModelUnknowns>() += 1e8 * fixed * fixed.transpose();
    const Eigen::LDLT<Eigen::MatrixXd> ldlt(h);
    return ldlt.solve(Eigen::MatrixXd::Identity(unknowns_, kModelUnknowns)).topRows<kModelUnknowns>();
  }

  const std::vector<PhotometricObservation>& observations() const { return observations_; }

 private:
  struct Cross {
    int frame;
    double value;
  };

  static bool Valid(const PhotometricModel& model) {
    if (!(model.kappa > 0.05 && model.kappa < 5.0)) return false;
    for (int i = 0; i <= 20; ++i) {
      if (!(model.Vignette(i / 20.0) > kMinVignette)) return false;
    }
    for (const double c : model.response) {
      if (!(std::abs(c) < 20.0)) return false;
    }
    return true;
  }

  double Loss(double r) const {
    const double magnitude = std::abs(r);
    return magnitude < options_.huber ? r * r : options_.huber * (2.0 * magnitude - options_.huber);
  }

  double PriorCost(const State& state) const {
    double cost = 0.0;
    const auto square = [](double v) { return v * v; };
    for (const double c : state.model.response) cost += square(c / options_.response_sigma);
    for (const double v : state.model.vignette) cost += square(v / options_.vignette_sigma);
    cost += square((state.model.kappa - 1.0) / KappaSigma());
    if (!known_) cost += state.log_exposure.squaredNorm() / square(options_.exposure_sigma);
    return cost;
  }

  void AddPriors(const State& state) {
    const auto add = [&](int at, double value, double sigma) {
      h_(at, at) += 1.0 / (sigma * sigma);
      b_[at] += value / (sigma * sigma);
    };
    for (int k = 0; k < kResponseTerms; ++k) add(1 + k, state.model.response[k], options_.response_sigma);
    for (int k = 0; k < kVignetteTerms; ++k) add(kVignetteAt + k, state.model.vignette[k], options_.vignette_sigma);
    add(0, state.model.kappa - 1.0, KappaSigma());
    if (known_) return;
    for (int j = 0; j < frames_; ++j) add(kModelUnknowns + j, state.log_exposure[j], options_.exposure_sigma);
  }

  void Accumulate(const State& state, const PhotometricPredictor& predictor, const PhotometricObservation& o,
                  PhotometricVector* model_row) {
    const PhotometricPrediction p =
        predictor.Predict(state.log_radiance[o.point], state.log_exposure[o.frame], o.radius);
    const double r = (p.intensity - o.intensity) / o.sigma_gray;
    const double weight = std::min(1.0, options_.huber / std::max(std::abs(r), 1e-12)) / (o.sigma_gray * o.sigma_gray);
    const double wr = weight * (p.intensity - o.intensity);
    h_.topLeftCorner<kModelUnknowns, kModelUnknowns>().noalias() += weight * p.d_model * p.d_model.transpose();
    b_.head<kModelUnknowns>() += wr * p.d_model;
    *model_row += weight * p.d_radiance * p.d_model;
    h_point_[o.point] += weight * p.d_radiance * p.d_radiance;
    b_point_[o.point] += wr * p.d_radiance;
    if (known_) return;
    const int at = kModelUnknowns + o.frame;
    h_.block<1, kModelUnknowns>(at, 0) += weight * p.d_exposure * p.d_model.transpose();
    h_(at, at) += weight * p.d_exposure * p.d_exposure;
    b_[at] += wr * p.d_exposure;
    rows_.push_back({o.frame, weight * p.d_radiance * p.d_exposure});
  }

  void Eliminate(double damping) {
    for (int point = 0; point < points_; ++point) {
      const double h = h_point_[point] * (1.0 + damping);
      if (!(h > 0.0)) continue;
      const auto& model_row = model_rows_[point];
      reduced_h_.topLeftCorner<kModelUnknowns, kModelUnknowns>().noalias() -= model_row / h * model_row.transpose();
      reduced_b_.head<kModelUnknowns>() -= (b_point_[point] / h) * model_row;
      for (std::size_t k = row_begin_[point]; k < row_begin_[point + 1]; ++k) {
        const int at = kModelUnknowns + rows_[k].frame;
        const double scaled = rows_[k].value / h;
        reduced_h_.block<1, kModelUnknowns>(at, 0) -= scaled * model_row.transpose();
        reduced_b_[at] -= scaled * b_point_[point];
        for (std::size_t l = row_begin_[point]; l < row_begin_[point + 1]; ++l) {
          reduced_h_(at, kModelUnknowns + rows_[l].frame) -= scaled * rows_[l].value;
        }
      }
    }
    reduced_h_.topRightCorner(kModelUnknowns, unknowns_ - kModelUnknowns) =
        reduced_h_.bottomLeftCorner(unknowns_ - kModelUnknowns, kModelUnknowns).transpose();
  }

  // Without exposure times kappa is fixed; with them a weak prior stands in where they do not vary.
  double KappaSigma() const { return known_ ? 1.0 : 1e-6; }

  std::vector<PhotometricObservation> observations_;
  int frames_, points_;
  bool known_;
  PhotometricAdjustmentOptions options_;
  int unknowns_;
  Eigen::MatrixXd h_, reduced_h_;
  Eigen::VectorXd b_, reduced_b_;
  std::vector<Cross> rows_;  // of the frames, point after point
  std::vector<std::size_t> row_begin_;
  std::vector<PhotometricVector> model_rows_;
  std::vector<double> h_point_, b_point_;
};

// Keeps what can be used, numbers the points from 0, sorts by point and frame.
std::vector<PhotometricObservation> Usable(const std::vector<PhotometricObservation>& all,
                                           const PhotometricAdjustmentOptions& options, int* points) {
  std::vector<PhotometricObservation> in_range, out;
  for (const PhotometricObservation& o : all) {
    if (o.intensity >= options.min_intensity && o.intensity <= options.max_intensity) in_range.push_back(o);
  }
  std::sort(in_range.begin(), in_range.end(),
            [](const auto& a, const auto& b) { return a.point != b.point ? a.point < b.point : a.frame < b.frame; });
  *points = 0;
  for (std::size_t begin = 0, end; begin < in_range.size(); begin = end) {
    for (end = begin; end < in_range.size() && in_range[end].point == in_range[begin].point; ++end) {
    }
    if (static_cast<int>(end - begin) < options.min_point_frames) continue;
    for (std::size_t i = begin; i < end; ++i) {
      out.push_back(in_range[i]);
      out.back().point = *points;
    }
    ++*points;
  }
  return out;
}

absl::Status CheckInput(const std::vector<PhotometricObservation>& observations, const std::vector<double>& exposure_s,
                        bool known) {
  for (const double exposure : exposure_s) {
    if (!(exposure >= 0.0) || !std::isfinite(exposure) || (exposure > 0.0) != known) {
      return absl::InvalidArgumentError(
          absl::StrCat("exposure times must all be positive, or all 0 for unknown; one is ", exposure));
    }
  }
  for (const PhotometricObservation& o : observations) {
    if (o.point < 0 || o.frame < 0 || o.frame >= static_cast<int>(exposure_s.size()) ||
        !(o.radius >= 0.0 && o.radius <= 1.0) || !std::isfinite(o.intensity) || !(o.sigma_gray > 0.0)) {
      return absl::InvalidArgumentError(absl::StrCat("observation of point ", o.point, " in frame ", o.frame, " of ",
                                                     exposure_s.size(), " with radius ", o.radius, ", intensity ",
                                                     o.intensity, ", sigma ", o.sigma_gray));
    }
  }
  return absl::OkStatus();
}

State InitialState(const std::vector<PhotometricObservation>& observations, const std::vector<double>& exposure_s,
                   bool known, int points) {
  State state;
  state.log_exposure = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(exposure_s.size()));
  if (known) {
    for (std::size_t j = 0; j < exposure_s.size(); ++j) state.log_exposure[j] = std::log(exposure_s[j]);
    state.log_exposure.array() -= state.log_exposure.mean();
  }
  state.log_radiance = Eigen::VectorXd::Zero(points);
  Eigen::VectorXd count = Eigen::VectorXd::Zero(points);
  for (const PhotometricObservation& o : observations) {
    state.log_radiance[o.point] += std::log(o.intensity / 255.0) - state.log_exposure[o.frame];
    count[o.point] += 1.0;
  }
  state.log_radiance.array() /= count.array().max(1.0);
  return state;
}

// The direction in which c and v move when all light is raised to another power, normalized: what no observation tells
// without exposure times.
PhotometricVector PowerDirection(const PhotometricModel& model) {
  const PhotometricPredictor predictor(model);
  constexpr int kSteps = 32;
  Eigen::Matrix<double, kSteps, kResponseTerms> by_response;
  Eigen::Matrix<double, kSteps, kVignetteTerms> by_vignette;
  Eigen::Matrix<double, kSteps, 1> response_change, vignette_change;
  for (int i = 0; i < kSteps; ++i) {
    const double z = (i + 0.5) / kSteps, vignette = model.Vignette(z), r2 = z * z;
    double by_z;
    ResponseVector row;
    predictor.Response(z, &by_z, &row);
    by_response.row(i) = row.transpose();
    response_change[i] = -by_z * z * std::log(z);
    by_vignette.row(i) << r2, r2 * r2, r2 * r2 * r2;
    vignette_change[i] = vignette * std::log(vignette);
  }
  PhotometricVector direction = PhotometricVector::Zero();
  direction.segment<kResponseTerms>(1) = by_response.colPivHouseholderQr().solve(response_change);
  direction.tail<kVignetteTerms>() = by_vignette.colPivHouseholderQr().solve(vignette_change);
  return direction.normalized();
}

// How far the intensities of the model may be off, for radiances spread evenly over the sensor's range.
void Uncertainty(const PhotometricModel& model, const Eigen::MatrixXd& covariance,
                 PhotometricAdjustmentResult* result) {
  const PhotometricPredictor predictor(model);
  double sum = 0.0;
  constexpr int kSteps = 32;
  for (int i = 1; i < kSteps; ++i) {
    // Off by the tone curve; a change of kappa moves the intensity of a known irradiance, too.
    const double irradiance = std::pow(static_cast<double>(i) / kSteps, 1.0 / model.kappa);
    PhotometricPrediction p = predictor.Predict(0.0, std::log(irradiance), 0.0);
    p.d_model.tail<kVignetteTerms>().setZero();
    sum += p.d_model.dot(covariance * p.d_model);
  }
  result->response_sigma = std::sqrt(std::max(0.0, sum / (kSteps - 1))) / 255.0;
  const auto v = covariance.bottomRightCorner<kVignetteTerms, kVignetteTerms>();
  result->vignette_sigma = std::sqrt(std::max(0.0, v.sum()));
}

}  // namespace

absl::Status PhotometricAdjustmentOptions::Validate() const {
  const struct {
    bool good;
    const char* what;
  } checks[] = {
      {huber > 0.0, "huber must be positive"},
      {response_sigma > 0.0 && vignette_sigma > 0.0 && exposure_sigma > 0.0, "the priors' sigmas must be positive"},
      {max_iterations >= 1, "max_iterations must be at least 1"},
      {min_intensity >= 0.0 && max_intensity <= 255.0 && min_intensity < max_intensity,
       "min_intensity and max_intensity must be in [0, 255], the second larger"},
      {min_point_frames >= 2, "min_point_frames must be at least 2"},
  };
  for (const auto& check : checks) {
    if (!check.good) return absl::InvalidArgumentError(check.what);
  }
  return absl::OkStatus();
}

absl::StatusOr<PhotometricAdjustmentResult> AdjustPhotometry(const std::vector<PhotometricObservation>& observations,
                                                             const std::vector<double>& exposure_s,
                                                             const PhotometricAdjustmentOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  const bool known = !exposure_s.empty() && exposure_s.front() > 0.0;
  CAIRN_RETURN_IF_ERROR(CheckInput(observations, exposure_s, known));
  int points = 0;
  std::vector<PhotometricObservation> usable = Usable(observations, options, &points);
  if (points < kMinPoints) {
    return absl::FailedPreconditionError(absl::StrCat(
        "only ", points, " surface points, of at least ", kMinPoints, ", were seen in ", options.min_point_frames,
        " frames or more with intensities from ", options.min_intensity, " to ", options.max_intensity));
  }
  State state = InitialState(usable, exposure_s, known, points);
  const int frames = static_cast<int>(exposure_s.size());
  Problem problem(std::move(usable), frames, points, known, options);
  PhotometricAdjustmentResult result;
  double cost = problem.Cost(state), damping = 1e-3;
  for (; result.iterations < options.max_iterations && damping < kMaxPhotometricDamping; ++result.iterations) {
    problem.Linearize(state, damping);
    State next;
    const double next_cost = problem.Step(damping, state, &next) ? problem.Cost(next) : 1e300;
    if (!(next_cost < cost)) {
      damping *= 8.0;
      continue;
    }
    const bool settled = cost - next_cost < 1e-6 * cost;
    state = next, cost = next_cost, damping = std::max(damping * 0.25, 1e-9);
    if (settled) break;
  }
  problem.Linearize(state, 0.0);
  result.model = state.model;
  result.points = points;
  result.observations = static_cast<int>(problem.observations().size());
  const PhotometricPredictor predictor(state.model);
  double squares = 0.0;
  int inliers = 0;
  std::vector<int> seen(exposure_s.size(), 0);
  for (const PhotometricObservation& o : problem.observations()) {
    const double r =
        predictor.Intensity(state.log_radiance[o.point], state.log_exposure[o.frame], o.radius) - o.intensity;
    ++seen[static_cast<std::size_t>(o.frame)];
    if (std::abs(r) > 2.0 * options.huber * o.sigma_gray) continue;
    squares += r * r;
    ++inliers;
  }
  result.inlier_share = static_cast<double>(inliers) / result.observations;
  result.rms_gray = std::sqrt(squares / std::max(inliers, 1));
  result.log_exposure.assign(state.log_exposure.begin(), state.log_exposure.end());
  for (std::size_t j = 0; j < seen.size(); ++j) {
    if (!known && seen[j] == 0) result.log_exposure[j] = std::numeric_limits<double>::quiet_NaN();
  }
  PhotometricVector fixed = PhotometricVector::Zero();
  if (!known) fixed = PowerDirection(state.model);
  Uncertainty(state.model, problem.ModelCovariance(fixed), &result);
  return result;
}

}  // namespace cairn::optimization

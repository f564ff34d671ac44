#include "optimization/photometric_model.h"

#include <algorithm>
#include <cmath>

namespace cairn::optimization {
namespace {

// Gauss-Legendre quadrature on [0, 1].
constexpr int kNodes = 8;
constexpr double kNode[kNodes] = {0.019855071751231884, 0.10166676129318664, 0.2372337950418355, 0.40828267875217511,
                                  0.59171732124782489,  0.76276620495816450, 0.8983332387068134, 0.98014492824876812};
constexpr double kWeight[kNodes] = {0.05061426814518813, 0.11119051722668724, 0.15685332293894364, 0.18134189168918099,
                                    0.18134189168918099, 0.15685332293894364, 0.11119051722668724, 0.05061426814518813};

ResponseVector Chebyshev(double s) {
  ResponseVector t;
  const double x = 2.0 * s - 1.0;
  double before = 1.0, now = x;
  for (int k = 0; k < kResponseTerms; ++k) {
    t[k] = now;
    const double next = 2.0 * x * now - before;
    before = now, now = next;
  }
  return t;
}

double Slope(const PhotometricModel& model, const ResponseVector& t) {
  double exponent = 0.0;
  for (int k = 0; k < kResponseTerms; ++k) exponent += model.response[k] * t[k];
  return std::exp(exponent);
}

// N(z) and its derivative by c.
double Integral(const PhotometricModel& model, double z, ResponseVector* by_response) {
  double sum = 0.0;
  if (by_response != nullptr) by_response->setZero();
  for (int i = 0; i < kNodes; ++i) {
    const ResponseVector t = Chebyshev(z * kNode[i]);
    const double slope = z * kWeight[i] * Slope(model, t);
    sum += slope;
    if (by_response != nullptr) *by_response += slope * t;
  }
  return sum;
}

}  // namespace

double PhotometricModel::Vignette(double radius) const {
  const double r2 = radius * radius;
  return 1.0 + r2 * (vignette[0] + r2 * (vignette[1] + r2 * vignette[2]));
}

double PhotometricModel::Intensity(double irradiance) const {
  double by_z;
  const double z = std::pow(std::clamp(irradiance, 0.0, 1.0), kappa);
  return 255.0 * PhotometricPredictor(*this).Response(z, &by_z, nullptr);
}

std::array<double, 256> PhotometricModel::InverseResponse() const {
  const PhotometricPredictor predictor(*this);
  std::array<double, 256> inverse{};
  double by_z;
  for (int i = 1; i < 255; ++i) {
    double low = 0.0, high = 1.0;
    for (int k = 0; k < 60; ++k) {
      const double middle = 0.5 * (low + high);
      (255.0 * predictor.Response(middle, &by_z, nullptr) < i ? low : high) = middle;
    }
    inverse[static_cast<std::size_t>(i)] = 255.0 * std::pow(low, 1.0 / kappa);
  }
  inverse[255] = 255.0;
  return inverse;
}

PhotometricPredictor::PhotometricPredictor(const PhotometricModel& model)
    : model_(model), whole_(Integral(model, 1.0, &whole_by_response_)) {
  slope_at_one_ = Slope(model, Chebyshev(1.0)) / whole_;
}

double PhotometricPredictor::Response(double z, double* by_z, ResponseVector* by_response) const {
  if (z > 1.0) {
    *by_z = slope_at_one_;
    if (by_response != nullptr) {
      *by_response = (z - 1.0) * slope_at_one_ * (Chebyshev(1.0) - whole_by_response_ / whole_);
    }
    return 1.0 + slope_at_one_ * (z - 1.0);
  }
  const double value = Integral(model_, z, by_response) / whole_;
  *by_z = Slope(model_, Chebyshev(z)) / whole_;
  if (by_response != nullptr) *by_response = (*by_response - value * whole_by_response_) / whole_;
  return value;
}

double PhotometricPredictor::Intensity(double log_radiance, double log_exposure, double radius) const {
  double by_z;
  const double gain = log_exposure + std::log(model_.Vignette(radius));
  return 255.0 * Response(std::exp(model_.kappa * gain + log_radiance), &by_z, nullptr);
}

PhotometricPrediction PhotometricPredictor::Predict(double log_radiance, double log_exposure, double radius) const {
  const double r2 = radius * radius, vignette = model_.Vignette(radius);
  const double gain = log_exposure + std::log(vignette);
  const double z = std::exp(model_.kappa * gain + log_radiance);
  double by_z;
  ResponseVector by_response;
  PhotometricPrediction p;
  p.intensity = 255.0 * Response(z, &by_z, &by_response);
  p.d_radiance = 255.0 * by_z * z;
  p.d_exposure = p.d_radiance * model_.kappa;
  p.d_model[0] = p.d_radiance * gain;
  p.d_model.segment<kResponseTerms>(1) = 255.0 * by_response;
  const double by_vignette = p.d_exposure / vignette;
  p.d_model[kVignetteAt] = by_vignette * r2;
  p.d_model[kVignetteAt + 1] = by_vignette * r2 * r2;
  p.d_model[kVignetteAt + 2] = by_vignette * r2 * r2 * r2;
  return p;
}

}  // namespace cairn::optimization

// How a camera turns light into gray values: response, vignette and exposure, with derivatives. The intensity of a
// point of radiance L, at radius rho from the image's centre (1 at its farthest corner), with exposure e is
//   I = 255 W(z),  z = (e V(rho) L)^kappa,  V(rho) = 1 + v1 rho^2 + v2 rho^4 + v3 rho^6
// (Bergmann, Wang, Cremers, RA-L 2018, Eq. 1 and 5).
//
// The response is increasing by construction, whatever its parameters c:
//   W(z) = N(z) / N(1),  N(z) = integral from 0 to z of exp(sum_k c_k T_k(2 s - 1)) ds   (T_k: Chebyshev polynomials),
// a power law followed by a smooth tone curve. (The paper's basis of measured responses, by Grossberg and Nayar, is
// data that may not come along.)
#pragma once

#include <Eigen/Core>
#include <array>

namespace cairn::optimization {

inline constexpr int kResponseTerms = 5;
inline constexpr int kVignetteTerms = 3;

struct PhotometricModel {
  double kappa = 1.0;
  std::array<double, kResponseTerms> response = {};  // c
  std::array<double, kVignetteTerms> vignette = {};  // v

  double Vignette(double radius) const;
  // Intensity in [0, 255] of an irradiance (exposure included) that is 1 where the sensor saturates.
  double Intensity(double irradiance) const;
  // The irradiance, scaled to [0, 255], of each gray value: strictly increasing from 0 to 255.
  std::array<double, 256> InverseResponse() const;
};

using ResponseVector = Eigen::Matrix<double, kResponseTerms, 1>;
using PhotometricVector = Eigen::Matrix<double, 1 + kResponseTerms + kVignetteTerms, 1>;  // kappa, c, v
inline constexpr int kPhotometricUnknowns = 1 + kResponseTerms + kVignetteTerms;
inline constexpr int kVignetteAt = 1 + kResponseTerms;

struct PhotometricPrediction {
  double intensity = 0.0;
  double d_radiance = 0.0;  // by the log radiance
  double d_exposure = 0.0;  // by the log exposure
  PhotometricVector d_model = PhotometricVector::Zero();
};

// Evaluates one model many times. Takes the log radiance with kappa included: z = exp(kappa (ln e + ln V) + m).
class PhotometricPredictor {
 public:
  explicit PhotometricPredictor(const PhotometricModel& model);

  double Intensity(double log_radiance, double log_exposure, double radius) const;
  PhotometricPrediction Predict(double log_radiance, double log_exposure, double radius) const;

  // W, its derivative by z, and, unless null, by c. Beyond z = 1, where nothing is observed, W goes on as a straight
  // line.
  double Response(double z, double* by_z, ResponseVector* by_response) const;

 private:
  PhotometricModel model_;
  ResponseVector whole_by_response_;  // of N(1)
  double whole_ = 1.0;                // N(1)
  double slope_at_one_ = 1.0;
};

}  // namespace cairn::optimization

#include "client/calibration_evidence.h"

#include <cmath>

namespace cairn::client {
namespace {

using optimization::kUsualFocalError;
using optimization::kUsualPrincipalError;

constexpr int kEnoughImages = 5;

}  // namespace

void CalibrationEvidence::Mean::Add(double value, double sigma, double usual) {
  const double one = 1.0 / (sigma * sigma + usual * usual);
  precision += one;
  weighted += one * value;
}

double CalibrationEvidence::Mean::sigma() const { return precision > 0.0 ? std::sqrt(1.0 / precision) : 1.0; }

void CalibrationEvidence::Add(const Sighting& sighting) {
  if (!sighting.calibration) return;
  const optimization::FocalEstimate& one = *sighting.calibration;
  ++images_;
  log_focal_.Add(std::log(one.scale), one.log_sigma, kUsualFocalError);
  shift_x_.Add(one.principal_shift.x(), one.principal_sigma.x(), kUsualPrincipalError);
  shift_y_.Add(one.principal_shift.y(), one.principal_sigma.y(), kUsualPrincipalError);
}

optimization::FocalEstimate CalibrationEvidence::Together() const {
  optimization::FocalEstimate together;
  together.scale = std::exp(log_focal_.value());
  together.log_sigma = log_focal_.sigma();
  together.principal_shift = {shift_x_.value(), shift_y_.value()};
  together.principal_sigma = {shift_x_.sigma(), shift_y_.sigma()};
  return together;
}

double CalibrationEvidence::focal_factor() const {
  if (images_ < kEnoughImages) return 1.0;
  const optimization::FocalEstimate together = Together();
  return together.Contradicts() ? together.scale : 1.0;
}

Matrix6d CalibrationEvidence::Cover(const Sighting& sighting) const {
  if (!sighting.calibration || focal_factor() == 1.0) return sighting.covariance;
  const Eigen::Vector3d off(log_focal_.value(), shift_x_.value(), shift_y_.value());
  const Vector6d apart = sighting.place.map_from_camera.Adjoint() * (sighting.calibration->by_calibration * off);
  return sighting.covariance + apart * apart.transpose();
}

}  // namespace cairn::client

#include "client/calibration_evidence.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/random.h"

namespace cairn::client {
namespace {

Sighting Showing(double log_focal, double sigma) {
  Sighting sighting;
  sighting.found = true;
  sighting.covariance = 1e-6 * Matrix6d::Identity();
  optimization::FocalEstimate estimate;
  estimate.scale = std::exp(log_focal);
  estimate.log_sigma = sigma;
  estimate.principal_sigma = {0.02, 0.02};
  estimate.by_calibration(2, 0) = 3.0;  // a scene three units away
  sighting.calibration = estimate;
  return sighting;
}

TEST(CalibrationEvidence, ImagesTellTogetherWhatOneDoesNot) {
  CalibrationEvidence evidence;
  Random random(1);
  for (int i = 0; i < 30; ++i) {
    const Sighting sighting = Showing(-0.08 + 0.03 * random.Normal(), 0.03);
    evidence.Add(sighting);
    if (i == 3) {
      EXPECT_EQ(evidence.focal_factor(), 1.0) << "too few";
    }
  }
  EXPECT_NEAR(std::log(evidence.focal_factor()), -0.08, 0.02);
  const Matrix6d covered = evidence.Cover(Showing(-0.08, 0.03));
  EXPECT_NEAR(std::sqrt(covered(2, 2)), 0.24, 0.06);
  EXPECT_NEAR(std::sqrt(covered(0, 0)), 1e-3, 1e-6);
}

TEST(CalibrationEvidence, WhatMapsErrIsNoContradiction) {
  CalibrationEvidence evidence;
  Random random(2);
  for (int i = 0; i < 1000; ++i) evidence.Add(Showing(0.02 + 0.01 * random.Normal(), 0.005));
  EXPECT_EQ(evidence.focal_factor(), 1.0);
  EXPECT_EQ(evidence.Cover(Showing(0.02, 0.005))(2, 2), 1e-6);
}

TEST(CalibrationEvidence, NothingIsSaidWithoutAny) {
  CalibrationEvidence evidence;
  for (int i = 0; i < 10; ++i) evidence.Add(Sighting());
  EXPECT_EQ(evidence.focal_factor(), 1.0);
}

}  // namespace
}  // namespace cairn::client

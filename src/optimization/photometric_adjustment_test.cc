#include "optimization/photometric_adjustment.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "base/random.h"

namespace cairn::optimization {
namespace {

// A camera that is not of the model's own family: an S-shaped or saturating response, a vignette with a cosine.
struct World {
  std::function<double(double)> response;  // [0, 1] to [0, 1]
  double exposure_swing = 0.4;
  double radius_step = 0.06;  // how far a point moves between frames
  double noise_gray = 1.5;
  int frames = 60, points = 500;

  static double Vignette(double radius) { return std::pow(std::cos(0.75 * radius), 3.0); }

  std::vector<double> exposure_s;
  std::vector<PhotometricObservation> observations;

  void Make() {
    Random random(7);
    for (int j = 0; j < frames; ++j) {
      exposure_s.push_back(0.01 * std::exp(exposure_swing * (std::sin(0.21 * j) + 0.4 * std::sin(0.83 * j + 1.0))));
    }
    for (int p = 0; p < points; ++p) {
      const double light = std::exp(random.Uniform(std::log(0.02), std::log(0.9)));
      const int first = static_cast<int>(random.Uniform(0, frames - 12)), length = 6 + p % 20;
      double radius = random.Uniform(0.0, 1.0), step = radius_step * random.Uniform(-1.0, 1.0);
      for (int j = first; j < std::min(frames, first + length); ++j) {
        const double irradiance = light * Vignette(radius) * exposure_s[static_cast<std::size_t>(j)] / 0.01;
        double intensity = 255.0 * response(std::min(irradiance, 1.0)) + noise_gray * random.Normal();
        if (p % 25 == 3 && j % 5 == 0) intensity += 60.0;  // a track that slipped
        observations.push_back({p, j, radius, std::clamp(std::round(intensity), 0.0, 255.0), noise_gray});
        radius += step;
        if (radius < 0.0 || radius > 1.0) step = -step, radius = std::clamp(radius, 0.0, 1.0);
      }
    }
  }
};

double Shoulder(double x) { return (1.0 - std::exp(-2.2 * x)) / (1.0 - std::exp(-2.2)); }
double Gamma(double x) { return std::pow(x, 1.0 / 2.2); }
double Film(double x) {
  const double y = std::pow(x, 0.6);
  return y * (1.0 + 0.35 * (1.0 - y) * (2.0 * y - 0.6));
}

// Largest error of the inverse response over the gray values that were seen, as a share of full scale, once the true
// light is raised to `power`.
double ResponseError(const PhotometricModel& model, const std::function<double(double)>& response, double power) {
  const std::array<double, 256> inverse = model.InverseResponse();
  double worst = 0.0, scale = 0.0, count = 0.0;
  const auto light_of = [&](int i) {
    double low = 0.0, high = 1.0;
    for (int k = 0; k < 50; ++k) (255.0 * response(0.5 * (low + high)) < i ? low : high) = 0.5 * (low + high);
    return std::pow(low, power);
  };
  // Where nothing is seen, next to saturation, the scale of the light is not known.
  for (int i = 120; i <= 220; ++i) scale += inverse[static_cast<std::size_t>(i)] / 255.0 / light_of(i), count += 1.0;
  for (int i = 10; i <= 245; ++i) {
    worst = std::max(worst, std::abs(inverse[static_cast<std::size_t>(i)] / 255.0 * count / scale - light_of(i)));
  }
  return worst;
}

double VignetteError(const PhotometricModel& model, double power) {
  double worst = 0.0;
  for (double r = 0.0; r <= 1.0; r += 0.05) {
    worst = std::max(worst, std::abs(model.Vignette(r) - std::pow(World::Vignette(r), power)));
  }
  return worst;
}

TEST(PhotometricAdjustment, JacobiansAgreeWithDifferences) {
  PhotometricModel model;
  model.kappa = 0.7;
  model.response = {0.4, -0.3, 0.2, 0.1, -0.15};
  model.vignette = {-0.3, 0.1, -0.2};
  constexpr double kStep = 1e-6;
  for (const double radiance : {-2.5, -0.6, 0.2}) {  // the last beyond saturation
    const double exposure = 0.1, radius = 0.8;
    const PhotometricPrediction p = PhotometricPredictor(model).Predict(radiance, exposure, radius);
    const auto check = [&](double derivative, const std::function<double(double)>& at, const char* what) {
      EXPECT_NEAR(derivative, (at(kStep) - at(-kStep)) / (2 * kStep), 1e-5 * (1.0 + std::abs(derivative)))
          << what << " at " << radiance;
    };
    check(
        p.d_radiance, [&](double d) { return PhotometricPredictor(model).Intensity(radiance + d, exposure, radius); },
        "radiance");
    check(
        p.d_exposure, [&](double d) { return PhotometricPredictor(model).Intensity(radiance, exposure + d, radius); },
        "exposure");
    for (int k = 0; k < p.d_model.size(); ++k) {
      check(
          p.d_model[k],
          [&](double d) {
            PhotometricModel moved = model;
            if (k == 0) {
              moved.kappa += d;
            } else if (k <= kResponseTerms) {
              moved.response[static_cast<std::size_t>(k - 1)] += d;
            } else {
              moved.vignette[static_cast<std::size_t>(k - 1 - kResponseTerms)] += d;
            }
            return PhotometricPredictor(moved).Intensity(radiance, exposure, radius);
          },
          "model");
    }
  }
}

TEST(PhotometricAdjustment, InverseResponseInvertsAndIncreases) {
  PhotometricModel model;
  model.kappa = 0.5;
  model.response = {1.5, -1.0, 0.5, 0.3, -0.4};
  const std::array<double, 256> inverse = model.InverseResponse();
  EXPECT_EQ(inverse[0], 0.0);
  EXPECT_EQ(inverse[255], 255.0);
  for (std::size_t i = 1; i < 256; ++i) {
    EXPECT_GT(inverse[i], inverse[i - 1]);
    EXPECT_NEAR(model.Intensity(inverse[i] / 255.0), static_cast<double>(i), 1e-3);
  }
}

TEST(PhotometricAdjustment, KnownExposuresGiveResponseAndVignette) {
  for (const auto& response : {Shoulder, Gamma, Film}) {
    World world;
    world.response = response;
    world.Make();
    const auto result = AdjustPhotometry(world.observations, world.exposure_s);
    ASSERT_TRUE(result.ok()) << result.status();
    EXPECT_LT(ResponseError(result->model, response, 1.0), 0.03);
    EXPECT_LT(VignetteError(result->model, 1.0), 0.03);
    EXPECT_LT(result->rms_gray, 1.6);
    EXPECT_GT(result->inlier_share, 0.95);
    EXPECT_LT(result->response_sigma, 0.02);
    EXPECT_LT(result->vignette_sigma, 0.02);
  }
}

TEST(PhotometricAdjustment, UnknownExposuresAreFoundUpToAPower) {
  for (const auto& response : {Shoulder, Gamma, Film}) {
    World world;
    world.response = response;
    world.Make();
    const auto result = AdjustPhotometry(world.observations, std::vector<double>(world.exposure_s.size(), 0.0));
    ASSERT_TRUE(result.ok()) << result.status();
    // The power: slope of the estimated over the true log exposures.
    double xy = 0.0, xx = 0.0, mean = 0.0;
    for (const double e : world.exposure_s) mean += std::log(e) / world.frames;
    for (std::size_t j = 0; j < world.exposure_s.size(); ++j) {
      xy += result->log_exposure[j] * (std::log(world.exposure_s[j]) - mean);
      xx += std::pow(std::log(world.exposure_s[j]) - mean, 2);
    }
    const double power = xy / xx;
    EXPECT_GT(power, 0.3);
    EXPECT_LT(power, 1.5);
    for (std::size_t j = 0; j < world.exposure_s.size(); ++j) {
      EXPECT_NEAR(result->log_exposure[j], power * (std::log(world.exposure_s[j]) - mean), 0.04);
    }
    EXPECT_LT(ResponseError(result->model, response, power), 0.03);
    EXPECT_LT(VignetteError(result->model, power), 0.03);
  }
}

TEST(PhotometricAdjustment, UncertaintySaysWhatWasNotSeen) {
  World still;  // constant exposure, and every point keeps its place in the image
  still.response = Gamma;
  still.exposure_swing = 0.0;
  still.radius_step = 0.0;
  still.Make();
  const auto result = AdjustPhotometry(still.observations, still.exposure_s);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_GT(result->response_sigma, 0.05);
  EXPECT_GT(result->vignette_sigma, 0.5);
}

TEST(PhotometricAdjustment, RefusesWhatItCannotUse) {
  World world;
  world.response = Gamma;
  world.Make();
  std::vector<double> mixed = world.exposure_s;
  mixed[3] = 0.0;
  EXPECT_EQ(AdjustPhotometry(world.observations, mixed).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(AdjustPhotometry({}, {}).status().code(), absl::StatusCode::kFailedPrecondition);
  std::vector<PhotometricObservation> few(world.observations.begin(), world.observations.begin() + 100);
  EXPECT_EQ(AdjustPhotometry(few, world.exposure_s).status().code(), absl::StatusCode::kFailedPrecondition);
  std::vector<PhotometricObservation> white = world.observations;
  for (PhotometricObservation& o : white) o.intensity = 255.0;
  const absl::Status saturated = AdjustPhotometry(white, world.exposure_s).status();
  EXPECT_EQ(saturated.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_NE(saturated.message().find("only 0 surface points"), std::string::npos) << saturated;
  std::vector<PhotometricObservation> bad = world.observations;
  bad[5].radius = 1.5;
  EXPECT_EQ(AdjustPhotometry(bad, world.exposure_s).status().code(), absl::StatusCode::kInvalidArgument);
  bad[5] = world.observations[5];
  bad[5].frame = 1000;
  EXPECT_EQ(AdjustPhotometry(bad, world.exposure_s).status().code(), absl::StatusCode::kInvalidArgument);
  PhotometricAdjustmentOptions options;
  options.min_intensity = 260.0;
  EXPECT_FALSE(AdjustPhotometry(world.observations, world.exposure_s, options).ok());
}

}  // namespace
}  // namespace cairn::optimization

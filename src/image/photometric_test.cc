#include "image/photometric.h"

#include <gtest/gtest.h>

#include <cmath>

namespace cairn::image {
namespace {

std::vector<double> Gamma(double gamma) {
  std::vector<double> inverse(256);
  for (int i = 0; i < 256; ++i) inverse[i] = 3.0 + 17.0 * std::pow(i / 255.0, gamma);
  return inverse;
}

TEST(Photometric, WithoutCalibrationIntensityIsIrradiance) {
  const PhotometricCalibration none;
  EXPECT_TRUE(none.IsIdentity());
  cv::Mat raw(1, 256, CV_8UC1);
  for (int i = 0; i < 256; ++i) raw.at<std::uint8_t>(i) = static_cast<std::uint8_t>(i);
  const auto out = none.Irradiance(raw);
  ASSERT_TRUE(out.ok());
  for (int i = 0; i < 256; ++i) EXPECT_EQ(out->at<float>(i), static_cast<float>(i));
}

TEST(Photometric, InvertsTheResponseAndTheVignette) {
  cv::Mat vignette(2, 3, CV_16UC1, cv::Scalar(40000));
  vignette.at<std::uint16_t>(0, 1) = 20000;
  vignette.at<std::uint16_t>(1, 2) = 0;
  const auto calibration = PhotometricCalibration::Create(Gamma(2.0), vignette);
  ASSERT_TRUE(calibration.ok()) << calibration.status();
  EXPECT_TRUE(calibration->has_response());
  const cv::Mat raw(2, 3, CV_8UC1, cv::Scalar(100));
  const auto out = calibration->Irradiance(raw);
  ASSERT_TRUE(out.ok());
  const float linear = 255.0f * (100.0f / 255.0f) * (100.0f / 255.0f);
  EXPECT_NEAR(out->at<float>(0, 0), linear, 1e-3);
  EXPECT_NEAR(out->at<float>(0, 1), 2 * linear, 1e-3);
  EXPECT_NEAR(out->at<float>(1, 2), PhotometricCalibration::kMaxGain * linear, 1e-2);
  EXPECT_EQ(calibration->inverse_response()[0], 0.0f);
  EXPECT_EQ(calibration->inverse_response()[255], 255.0f);
}

TEST(Photometric, CorrectedIsTheIrradianceUnderTheNearestPowerLaw) {
  cv::Mat vignette(1, 2, CV_16UC1, cv::Scalar(60000));
  vignette.at<std::uint16_t>(1) = 30000;
  const auto calibration = PhotometricCalibration::Create(Gamma(2.2), vignette);
  ASSERT_TRUE(calibration.ok()) << calibration.status();
  EXPECT_NEAR(calibration->gamma(), 2.2, 1e-3);
  for (const int level : {3, 40, 200}) {
    const cv::Mat raw(1, 2, CV_8UC1, cv::Scalar(level));
    const auto out = calibration->Corrected(raw);
    ASSERT_TRUE(out.ok());
    // A camera that is a power law itself keeps its gray values, but for the vignette.
    EXPECT_NEAR(out->at<float>(0), level, 0.02);
    EXPECT_NEAR(out->at<float>(1), level * std::pow(2.0, 1.0 / 2.2), 0.05);
    const cv::Mat irradiance = *calibration->Irradiance(raw);
    EXPECT_NEAR(out->at<float>(1), 255.0 * std::pow(irradiance.at<float>(1) / 255.0, 1.0 / 2.2), 0.05);
  }
  // Twice the exposure is a factor of the corrected image.
  EXPECT_NEAR(calibration->ExposureGain(0.02) / calibration->ExposureGain(0.01), std::pow(2.0, 1.0 / 2.2), 1e-3);
  EXPECT_EQ(calibration->ExposureGain(0.0), 0.0);
  EXPECT_EQ(PhotometricCalibration::Create({}, vignette)->ExposureGain(0.01), 0.0);  // the response is unknown
  EXPECT_NEAR(PhotometricCalibration::Create(Gamma(1.0), {})->gamma(), 1.0, 1e-3);
}

TEST(Photometric, EightBitVignette) {
  cv::Mat vignette(1, 2, CV_8UC1, cv::Scalar(200));
  vignette.at<std::uint8_t>(1) = 50;
  const auto out = PhotometricCalibration::Create({}, vignette)->Irradiance(cv::Mat(1, 2, CV_8UC1, cv::Scalar(10)));
  EXPECT_FLOAT_EQ(out->at<float>(0), 10.0f);
  EXPECT_FLOAT_EQ(out->at<float>(1), 40.0f);
}

TEST(Photometric, RefusesBadCalibrations) {
  EXPECT_FALSE(PhotometricCalibration::Create(std::vector<double>(255, 1.0), {}).ok());
  std::vector<double> flat = Gamma(1.0);
  flat[77] = flat[76];
  const absl::Status status = PhotometricCalibration::Create(flat, {}).status();
  EXPECT_NE(status.message().find("value 78"), std::string::npos) << status;
  flat = Gamma(1.0);
  flat[0] = NAN;
  EXPECT_FALSE(PhotometricCalibration::Create(flat, {}).ok());
  EXPECT_FALSE(PhotometricCalibration::Create({}, cv::Mat(2, 2, CV_8UC3, cv::Scalar(1))).ok());
  EXPECT_FALSE(PhotometricCalibration::Create({}, cv::Mat(2, 2, CV_8UC1, cv::Scalar(0))).ok());
  EXPECT_FALSE(PhotometricCalibration::Create({}, cv::Mat(2, 2, CV_32FC1, cv::Scalar(-1))).ok());
}

TEST(Photometric, SizesMustAgree) {
  const auto calibration = PhotometricCalibration::Create({}, cv::Mat(4, 6, CV_8UC1, cv::Scalar(9)));
  ASSERT_TRUE(calibration.ok());
  EXPECT_TRUE(calibration->ValidateFor(Camera::FromPinhole({6, 4, 5, 5, 3, 2})).ok());
  const absl::Status status = calibration->ValidateFor(Camera::FromPinhole({8, 4, 5, 5, 3, 2}));
  EXPECT_NE(status.message().find("6x4"), std::string::npos);
  EXPECT_NE(status.message().find("8x4"), std::string::npos);
  EXPECT_FALSE(calibration->Irradiance(cv::Mat(4, 8, CV_8UC1)).ok());
  EXPECT_FALSE(calibration->Irradiance(cv::Mat(4, 6, CV_8UC3)).ok());
}

TEST(PrepareImage, CorrectsBeforeUndistorting) {
  const Camera camera = {CameraModel::kRadialTangential, 64, 48, 40, 40, 32, 24, {-0.2, 0.05, 0, 0}};
  const auto undistorter = Undistorter::Create(camera);
  ASSERT_TRUE(undistorter.ok()) << undistorter.status();
  // An evenly lit wall behind a vignette: bright again everywhere once corrected.
  cv::Mat vignette(48, 64, CV_16UC1), raw(48, 64, CV_8UC1);
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 64; ++x) {
      const double v = 1.0 - 0.0004 * ((x - 32) * (x - 32) + (y - 24) * (y - 24));
      vignette.at<std::uint16_t>(y, x) = static_cast<std::uint16_t>(std::lround(65535 * v));
      raw.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(std::lround(200 * v));
    }
  }
  const auto calibration = PhotometricCalibration::Create({}, vignette);
  const auto prepared = PrepareImage(raw, *undistorter, &*calibration);
  ASSERT_TRUE(prepared.ok()) << prepared.status();
  EXPECT_EQ(prepared->gray.type(), CV_8UC1);
  EXPECT_EQ(prepared->corrected.type(), CV_32FC1);
  double low, high;
  cv::minMaxLoc(prepared->corrected, &low, &high);
  EXPECT_NEAR(low, 200, 2.0);
  EXPECT_NEAR(high, 200, 2.0);
  EXPECT_TRUE(PrepareImage(raw, *undistorter, nullptr)->corrected.empty());
  EXPECT_FALSE(PrepareImage(cv::Mat(48, 64, CV_8UC3), *undistorter, nullptr).ok());
  EXPECT_FALSE(PrepareImage(cv::Mat(10, 10, CV_8UC1), *undistorter, nullptr).ok());
}

}  // namespace
}  // namespace cairn::image

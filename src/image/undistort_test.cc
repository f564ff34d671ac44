#include "image/undistort.h"

#include <gtest/gtest.h>

#include <cmath>

namespace cairn::image {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

Camera Euroc() {
  return {CameraModel::kRadialTangential,
          752,
          480,
          458.654,
          457.296,
          367.215,
          248.375,
          {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05}};
}
Camera Fisheye() {
  return {CameraModel::kKannalaBrandt,
          512,
          512,
          190.978,
          190.973,
          254.931,
          256.897,
          {0.0034823894, 0.00071503, -0.0020532361, 0.00020293673}};
}
Camera Fov() { return {CameraModel::kFov, 640, 512, 344, 344.2, 321.9, 257.7, {0.92}}; }
Camera Pincushion() { return {CameraModel::kRadialTangential, 640, 480, 400, 400, 330, 236, {0.2, 0.05, 1e-3, -2e-3}}; }

TEST(Undistorter, APinholePassesThroughUncopied) {
  const Pinhole pinhole = {640, 480, 500, 510, 320, 240};
  const auto undistorter = Undistorter::Create(Camera::FromPinhole(pinhole));
  ASSERT_TRUE(undistorter.ok());
  EXPECT_TRUE(undistorter->identity());
  EXPECT_EQ(undistorter->pinhole(), pinhole);
  const cv::Mat image(480, 640, CV_8UC1, cv::Scalar(7));
  EXPECT_EQ(undistorter->Undistort(image)->data, image.data);
  Camera zeros = Camera::FromPinhole(pinhole);
  zeros.model = CameraModel::kRadialTangential;
  zeros.distortion.assign(4, 0.0);
  EXPECT_TRUE(Undistorter::Create(zeros)->identity());
}

TEST(Undistorter, EveryOutputPixelComesFromInside) {
  for (const Camera& camera : {Euroc(), Fisheye(), Fov(), Pincushion()}) {
    SCOPED_TRACE(camera.Describe());
    const auto undistorter = Undistorter::Create(camera);
    ASSERT_TRUE(undistorter.ok()) << undistorter.status();
    const Pinhole& view = undistorter->pinhole();
    EXPECT_EQ(view.width_px, camera.width_px);
    EXPECT_EQ(view.height_px, camera.height_px);
    EXPECT_NEAR(view.fx_px / view.fy_px, camera.fx_px / camera.fy_px, 1e-12);
    double slack_px = 1e9;
    for (int y = 0; y < view.height_px; ++y) {
      for (int x = 0; x < view.width_px; ++x) {
        const auto raw = undistorter->RawFromPinhole(Vector2d(x, y));
        ASSERT_TRUE(raw.has_value());
        ASSERT_TRUE(camera.Contains(*raw)) << x << " " << y << " from " << raw->transpose();
        slack_px =
            std::min({slack_px, raw->x(), raw->y(), camera.width_px - 1 - raw->x(), camera.height_px - 1 - raw->y()});
      }
    }
    // Nothing is given away: some pixel touches the border, or the widest angle is reached.
    const double widest = std::max({view.cx_px / view.fx_px, (view.width_px - 1 - view.cx_px) / view.fx_px,
                                    view.cy_px / view.fy_px, (view.height_px - 1 - view.cy_px) / view.fy_px});
    EXPECT_TRUE(slack_px < 0.1 || std::abs(widest - std::tan(60 * M_PI / 180)) < 1e-3) << slack_px << " " << widest;
    const cv::Mat white(camera.height_px, camera.width_px, CV_8UC1, cv::Scalar(255));
    double darkest = 0;
    cv::minMaxLoc(*undistorter->Undistort(white), &darkest);
    EXPECT_EQ(darkest, 255);
  }
}

// A raw image whose value is a smooth function of the ray must become that function of the pinhole's rays.
TEST(Undistorter, ShowsEachRayWhereThePinholeHasIt) {
  const auto brightness = [](const Vector3d& ray) {
    return 120 + 100 * std::sin(3 * ray.x() / ray.z()) * std::cos(2 * ray.y() / ray.z());
  };
  for (const Camera& camera : {Euroc(), Fov(), Pincushion()}) {
    SCOPED_TRACE(camera.Describe());
    const auto undistorter = Undistorter::Create(camera);
    ASSERT_TRUE(undistorter.ok());
    cv::Mat raw(camera.height_px, camera.width_px, CV_32FC1);
    for (int y = 0; y < raw.rows; ++y) {
      for (int x = 0; x < raw.cols; ++x) {
        raw.at<float>(y, x) = static_cast<float>(brightness(*camera.Unproject(Vector2d(x, y))));
      }
    }
    const auto flat = undistorter->Undistort(raw);
    ASSERT_TRUE(flat.ok());
    ASSERT_EQ(flat->type(), CV_32FC1);
    double worst = 0;
    for (int y = 0; y < flat->rows; y += 3) {
      for (int x = 0; x < flat->cols; x += 3) {
        const double truth = brightness(undistorter->pinhole().Unproject(Vector2d(x, y)));
        worst = std::max(worst, std::abs(flat->at<float>(y, x) - truth));
      }
    }
    EXPECT_LT(worst, 0.05);  // 1/64 px of rounding
  }
}

TEST(Undistorter, PixelsGoThereAndBack) {
  const auto undistorter = Undistorter::Create(Euroc());
  const Vector2d pixel(123.4, 345.6);
  EXPECT_LT((*undistorter->RawFromPinhole(*undistorter->PinholeFromRaw(pixel)) - pixel).norm(), 1e-6);
}

TEST(Undistorter, AGivenTargetIsUsedAndItsOutsideIsBlack) {
  UndistortOptions options;
  options.target = Pinhole{800, 600, 200, 200, 400, 300};
  const auto undistorter = Undistorter::Create(Euroc(), options);
  ASSERT_TRUE(undistorter.ok());
  EXPECT_EQ(undistorter->pinhole(), *options.target);
  const cv::Mat white(480, 752, CV_8UC1, cv::Scalar(255));
  const auto image = undistorter->Undistort(white);
  EXPECT_EQ(image->size(), cv::Size(800, 600));
  EXPECT_EQ(image->at<std::uint8_t>(0, 0), 0);
  EXPECT_EQ(image->at<std::uint8_t>(300, 400), 255);
}

// The same scene through a camera of many pixels and of few: what comes out is of one size and shows the same.
TEST(Undistorter, LargeImagesAreBroughtToTheWorkingSize) {
  for (const double k1 : {0.0, -0.2}) {
    const auto camera_of = [&](int scale) {
      Camera camera = Camera::FromPinhole(
          {800 * scale, 600 * scale, 500.0 * scale, 500.0 * scale, 400.0 * scale - 0.5, 300.0 * scale - 0.5});
      if (k1 != 0.0) camera.model = CameraModel::kRadialTangential, camera.distortion = {k1, 0.0, 0.0, 0.0};
      return camera;
    };
    // Gray values by direction: smooth, so that sampling costs nothing.
    const auto image_of = [](const Camera& camera) {
      cv::Mat image(camera.height_px, camera.width_px, CV_8UC1);
      for (int y = 0; y < image.rows; ++y) {
        for (int x = 0; x < image.cols; ++x) {
          const auto ray = camera.Unproject(Vector2d(x, y));
          const double value =
              128.0 + 100.0 * std::sin(9.0 * ray->x() / ray->z()) * std::cos(7.0 * ray->y() / ray->z());
          image.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(value);
        }
      }
      return image;
    };
    const Camera small = camera_of(1), large = camera_of(3);
    const auto one = Undistorter::Create(small), other = Undistorter::Create(large);
    ASSERT_TRUE(one.ok() && other.ok()) << other.status();
    EXPECT_EQ(one->identity(), k1 == 0.0);
    EXPECT_FALSE(other->identity());
    EXPECT_EQ(other->camera(), large);
    EXPECT_EQ(other->pinhole().width_px, 800);
    EXPECT_NEAR(other->pinhole().fx_px, one->pinhole().fx_px, 1e-6);
    EXPECT_NEAR(other->pinhole().cx_px, one->pinhole().cx_px, 1e-6);
    const auto of_small = one->Undistort(image_of(small)), of_large = other->Undistort(image_of(large));
    ASSERT_TRUE(of_small.ok() && of_large.ok()) << of_large.status();
    EXPECT_LE(cv::norm(*of_small, *of_large, cv::NORM_INF), 3.0);
    const auto there = other->PinholeFromRaw({300.0, 1000.0});
    ASSERT_TRUE(there.has_value());
    EXPECT_LT((*other->RawFromPinhole(*there) - Vector2d(300.0, 1000.0)).norm(), 1e-6);
    EXPECT_FALSE(other->Undistort(image_of(small)).ok());
  }
}

TEST(Undistorter, SmallImagesAreEnlarged) {
  const Camera camera = Camera::FromPinhole({160, 120, 105.0, 105.0, 79.5, 59.5});
  const auto undistorter = Undistorter::Create(camera);
  ASSERT_TRUE(undistorter.ok());
  EXPECT_EQ(undistorter->pinhole(), (Pinhole{640, 480, 420.0, 420.0, 319.5, 239.5}));
  EXPECT_FALSE(undistorter->identity());
  const auto image = undistorter->Undistort(cv::Mat(120, 160, CV_8UC1, cv::Scalar(77)));
  ASSERT_TRUE(image.ok());
  EXPECT_EQ(image->size(), cv::Size(640, 480));
  EXPECT_EQ(cv::norm(*image, cv::NORM_INF), 77.0);
  EXPECT_EQ(Undistorter::Create(Camera::FromPinhole({64, 48, 50, 51, 32, 24}))->pinhole().width_px, 256);
}

TEST(Undistorter, WrongInputsAreNamed) {
  const auto undistorter = Undistorter::Create(Euroc());
  const absl::Status size = undistorter->Undistort(cv::Mat(480, 640, CV_8UC1)).status();
  EXPECT_EQ(size.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(size.message().find("640x480"), std::string::npos);
  EXPECT_NE(size.message().find("752x480"), std::string::npos);
  EXPECT_FALSE(undistorter->Undistort(cv::Mat()).ok());
  EXPECT_FALSE(Undistorter::Create(Camera()).ok());
  UndistortOptions options;
  options.max_half_angle_deg = 90;
  EXPECT_FALSE(Undistorter::Create(Euroc(), options).ok());
  Camera aside = Euroc();  // the axis lies outside the image
  aside.cx_px = -100;
  EXPECT_EQ(Undistorter::Create(aside).status().code(), absl::StatusCode::kInvalidArgument);
  // Distortions that no lens has leave a view of a few pixels, of which nothing could be made.
  Camera absurd = Euroc();
  for (const double k1 : {1e4, 1e9, 1e15}) {
    absurd.distortion = {k1, 0, 0, 0};
    const absl::Status status = Undistorter::Create(absurd).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << k1 << ": " << status;
    EXPECT_NE(status.message().find("752x480"), std::string::npos) << status;
  }
}

}  // namespace
}  // namespace cairn::image

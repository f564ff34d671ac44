#include "geometry/camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/calib3d.hpp>

#include "base/random.h"

namespace cairn {
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

// Lenses of every model and number of coefficients.
std::vector<Camera> Cameras() {
  Camera five = Euroc(), eight = Euroc(), none = Euroc(), pincushion = Euroc();
  five.distortion = {-0.3, 0.11, -4e-4, 2e-4, -0.015};
  eight.distortion = {0.4, 0.02, 3e-4, -2e-4, 0.001, 0.75, 0.09, 0.002};
  none.distortion = {};
  pincushion.distortion = {0.15, 0.02, 1e-3, -1e-3};
  const Camera fisheye = {CameraModel::kKannalaBrandt,
                          512,
                          512,
                          190.978,
                          190.973,
                          254.931,
                          256.897,
                          {0.0034823894, 0.00071503, -0.0020532361, 0.00020293673}};
  const Camera fov = {CameraModel::kFov, 1280, 1024, 688.1, 688.4, 643.7, 515.5, {0.92}};
  const Camera narrow_fov = {CameraModel::kFov, 640, 480, 500, 500, 319, 241, {1e-5}};
  const Camera pinhole = {CameraModel::kPinhole, 640, 480, 525, 520, 320, 240, {}};
  return {Euroc(), five, eight, none, pincushion, fisheye, fov, narrow_fov, pinhole};
}

TEST(Camera, EveryPixelGoesThereAndBack) {
  for (const Camera& camera : Cameras()) {
    SCOPED_TRACE(camera.Describe());
    ASSERT_TRUE(camera.Validate().ok()) << camera.Validate();
    for (int y = 0; y < camera.height_px; y += 13) {
      for (int x = 0; x < camera.width_px; x += 13) {
        const Vector2d pixel(x + 0.25, y - 0.25);
        const auto ray = camera.Unproject(pixel);
        ASSERT_TRUE(ray.has_value()) << pixel.transpose();
        EXPECT_NEAR(ray->norm(), 1.0, 1e-12);
        const auto back = camera.Project(*ray * 3.7);
        ASSERT_TRUE(back.has_value()) << pixel.transpose();
        EXPECT_LT((*back - pixel).norm(), 1e-6) << pixel.transpose();
      }
    }
    const auto centre = camera.Unproject({camera.cx_px, camera.cy_px});
    ASSERT_TRUE(centre.has_value());
    EXPECT_LT((*centre - Vector3d::UnitZ()).norm(), 1e-9);
  }
}

TEST(Camera, JacobiansAgainstDifferences) {
  Random random(5);
  for (const Camera& camera : Cameras()) {
    SCOPED_TRACE(camera.Describe());
    for (int i = 0; i < 100; ++i) {
      Vector2d pixel(random.Uniform(0, camera.width_px - 1), random.Uniform(0, camera.height_px - 1));
      if (i == 0) pixel = {camera.cx_px, camera.cy_px};
      if (i == 1) pixel = {camera.cx_px + 1e-5, camera.cy_px};
      const Vector3d point = *camera.Unproject(pixel) * random.Uniform(0.5, 10.0);
      Eigen::Matrix<double, 2, 3> by_point;
      Eigen::Matrix<double, 2, Eigen::Dynamic> by_parameters;
      ASSERT_TRUE(camera.Project(point, &by_point, &by_parameters).has_value());
      for (int k = 0; k < 3; ++k) {
        const Vector3d d = 1e-6 * Vector3d::Unit(k);
        const Vector2d slope = (*camera.Project(point + d) - *camera.Project(point - d)) / 2e-6;
        EXPECT_LT((slope - by_point.col(k)).norm(), 1e-5 * std::max(1.0, slope.norm())) << k;
      }
      ASSERT_EQ(by_parameters.cols(), camera.NumParameters());
      for (int k = 0; k < camera.NumParameters(); ++k) {
        Camera plus = camera, minus = camera;
        double* const p[] = {&plus.fx_px, &plus.fy_px, &plus.cx_px, &plus.cy_px};
        double* const m[] = {&minus.fx_px, &minus.fy_px, &minus.cx_px, &minus.cy_px};
        *(k < 4 ? p[k] : &plus.distortion[k - 4]) += 1e-6;
        *(k < 4 ? m[k] : &minus.distortion[k - 4]) -= 1e-6;
        const Vector2d slope = (*plus.Project(point) - *minus.Project(point)) / 2e-6;
        EXPECT_LT((slope - by_parameters.col(k)).norm(), 1e-5 * std::max(1.0, slope.norm())) << k;
      }
    }
  }
}

TEST(Camera, AgreesWithOpenCv) {
  Random random(6);
  for (const Camera& camera : Cameras()) {
    if (camera.model == CameraModel::kFov) continue;  // not in OpenCV
    SCOPED_TRACE(camera.Describe());
    std::vector<cv::Point3d> points;
    std::vector<Vector2d> ours;
    for (int i = 0; i < 200; ++i) {
      const Vector2d pixel(random.Uniform(0, camera.width_px - 1), random.Uniform(0, camera.height_px - 1));
      const Vector3d point = *camera.Unproject(pixel) * random.Uniform(0.5, 10.0);
      if (point.z() < 0.05) continue;
      points.emplace_back(point.x(), point.y(), point.z());
      ours.push_back(*camera.Project(point));
    }
    const cv::Matx33d k(camera.fx_px, 0, camera.cx_px, 0, camera.fy_px, camera.cy_px, 0, 0, 1);
    const cv::Vec3d zero(0, 0, 0);
    std::vector<cv::Point2d> theirs;
    if (camera.model == CameraModel::kKannalaBrandt) {
      cv::fisheye::projectPoints(points, theirs, zero, zero, k, camera.distortion);
    } else {
      cv::projectPoints(points, zero, zero, k, camera.distortion, theirs);
    }
    ASSERT_EQ(theirs.size(), ours.size());
    for (std::size_t i = 0; i < ours.size(); ++i) {
      EXPECT_LT((Vector2d(theirs[i].x, theirs[i].y) - ours[i]).norm(), 1e-8);
    }
  }
}

TEST(Camera, FovAgreesWithItsFormulaAndItsLimit) {
  const Camera camera = {CameraModel::kFov, 640, 480, 1, 1, 0, 0, {0.9}};
  const double r = 0.7;
  EXPECT_NEAR(camera.Project({r, 0, 1})->x(), std::atan(2 * r * std::tan(0.45)) / 0.9, 1e-15);
  // The series for a small omega meets the formula.
  Camera below = camera, above = camera;
  below.distortion = {0.99999e-4};
  above.distortion = {1.00001e-4};
  EXPECT_NEAR(below.Project({r, 0.2, 1})->x(), above.Project({r, 0.2, 1})->x(), 1e-12);
  EXPECT_LT((*below.Unproject({0.7, 0.2}) - *above.Unproject({0.7, 0.2})).norm(), 1e-12);
}

TEST(Camera, SeesBesideItselfOnlyWithAFisheye) {
  const Camera fisheye = Cameras()[5];
  EXPECT_TRUE(fisheye.Project({1, 0, -0.05}).has_value());
  EXPECT_FALSE(fisheye.Project({0, 0, -1}).has_value());
  EXPECT_TRUE(fisheye.Project({0, 0, 1}).has_value());
  EXPECT_FALSE(fisheye.Project({0, 0, 0}).has_value());
  for (const Camera& camera : Cameras()) {
    if (camera.model == CameraModel::kKannalaBrandt) continue;
    EXPECT_FALSE(camera.Project({1, 0, -0.05}).has_value());
    EXPECT_FALSE(camera.Project({1, 0, 0}).has_value());
    EXPECT_FALSE(camera.Project({NAN, 0, 1}).has_value());
    EXPECT_FALSE(camera.Unproject({NAN, 0}).has_value());
  }
}

// With k1 < 0 alone the distorted radius has its maximum 2/3 r at r = 1 / sqrt(-3 k1) and turns back.
TEST(Camera, AFoldedPolynomialImagesNothing) {
  Camera camera = {CameraModel::kRadialTangential, 640, 480, 300, 300, 320, 240, {-1.0 / 3.0, 0, 0, 0}};
  EXPECT_TRUE(camera.Project({0.99, 0, 1}).has_value());
  EXPECT_FALSE(camera.Project({1.01, 0, 1}).has_value());
  EXPECT_FALSE(camera.Project({1.7, 0, 1}).has_value());  // would fall onto the image again
  EXPECT_TRUE(camera.Unproject({320 + 300 * 0.66, 240}).has_value());
  EXPECT_FALSE(camera.Unproject({320 + 300 * 0.67, 240}).has_value());
  Camera fisheye = {CameraModel::kKannalaBrandt, 640, 480, 300, 300, 320, 240, {-1.0 / 3.0, 0, 0, 0}};
  EXPECT_TRUE(fisheye.Unproject({320 + 300 * 0.66, 240}).has_value());
  EXPECT_FALSE(fisheye.Unproject({320 + 300 * 0.67, 240}).has_value());
}

TEST(Camera, FovHasAWidestRadius) {
  const Camera camera = {CameraModel::kFov, 640, 480, 300, 300, 320, 240, {1.0}};
  EXPECT_TRUE(camera.Unproject({320 + 300 * 1.57, 240}).has_value());
  EXPECT_FALSE(camera.Unproject({320 + 300 * 1.58, 240}).has_value());
}

TEST(Camera, ValidateSaysWhatIsWrong) {
  const auto wrong = [](auto change) {
    Camera camera = Euroc();
    change(camera);
    const absl::Status status = camera.Validate();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    return std::string(status.message());
  };
  EXPECT_NE(wrong([](Camera& c) { c.width_px = 0; }).find("0x480"), std::string::npos);
  EXPECT_NE(wrong([](Camera& c) { c.height_px = 40000; }).find("40000"), std::string::npos);
  EXPECT_NE(wrong([](Camera& c) { c.fx_px = -1; }).find("-1"), std::string::npos);
  EXPECT_NE(wrong([](Camera& c) { c.fy_px = NAN; }).find("nan"), std::string::npos);
  EXPECT_NE(wrong([](Camera& c) { c.cx_px = 1e6; }).find("principal"), std::string::npos);
  EXPECT_NE(wrong([](Camera& c) { c.distortion.resize(6); }).find("0, 4, 5 or 8"), std::string::npos);
  EXPECT_NE(wrong([](Camera& c) { c.distortion[1] = INFINITY; }).find("finite"), std::string::npos);
  EXPECT_NE(wrong([](Camera& c) { c.model = CameraModel::kPinhole; }).find("none"), std::string::npos);
  EXPECT_NE(wrong([](Camera& c) { c.model = CameraModel::kFov; }).find("takes 1"), std::string::npos);
  EXPECT_NE(wrong([](Camera& c) { c.model = CameraModel::kFov, c.distortion = {4.0}; }).find("omega"),
            std::string::npos);
}

TEST(Camera, NamesGoThereAndBack) {
  for (const Camera& camera : Cameras()) EXPECT_EQ(*CameraModelFromName(CameraModelName(camera.model)), camera.model);
  EXPECT_FALSE(CameraModelFromName("Pinhole").ok());
}

TEST(Camera, KnowsWhetherItBendsRays) {
  EXPECT_TRUE(Camera::FromPinhole({640, 480, 525, 525, 320, 240}).IsUndistorted());
  EXPECT_FALSE(Euroc().IsUndistorted());
  Camera zeros = Euroc();
  zeros.distortion.assign(5, 0.0);
  EXPECT_TRUE(zeros.IsUndistorted());
}

TEST(CameraValidate, BoundsTheSizeOfAnImage) {
  Camera camera{CameraModel::kPinhole, 11648, 8584, 9000.0, 9000.0, 5800.0, 4300.0, {}};  // 100 megapixels, the largest
  EXPECT_TRUE(camera.Validate().ok()) << camera.Validate();
  camera.width_px = camera.height_px = 32767;
  camera.cx_px = camera.cy_px = 16000.0;
  EXPECT_EQ(camera.Validate().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(camera.Validate().message().find("megapixels"), absl::string_view::npos) << camera.Validate();
}

}  // namespace
}  // namespace cairn

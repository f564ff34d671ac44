#include "image/undistort_kernel.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "base/cpu_features.h"
#include "base/random.h"

namespace cairn::image {
namespace {

// Positions all over a small image and around it, then all inside, and then along lines as a lens bends them, from
// image rows enlarged to reduced, forwards and backwards.
class UndistortKernel : public ::testing::TestWithParam<SimdLevel> {
 protected:
  static constexpr int kWidth = 67, kHeight = 41;

  UndistortKernel() : raw_(kHeight, kWidth, CV_8UC1), map_x_(160, 75, CV_32FC1), map_y_(160, 75, CV_32FC1) {
    Random random(11);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x)
        raw_.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(random.Uniform(0.0, 255.9));
    }
    for (int y = 0; y < 60; ++y) {
      const double rim = y < 30 ? 3.0 : -3.0;
      for (int x = 0; x < map_x_.cols; ++x) {
        map_x_.at<float>(y, x) = static_cast<float>(random.Uniform(-rim, kWidth - 1 + rim));
        map_y_.at<float>(y, x) = static_cast<float>(random.Uniform(-rim, kHeight - 1 + rim));
      }
    }
    for (int y = 60; y < map_x_.rows; ++y) {
      const int line = (y - 60) / 2;
      for (int x = 0; x < map_x_.cols; ++x) {
        const float along = -2.0f + static_cast<float>(x) * (0.3f + 0.05f * static_cast<float>(line));
        map_x_.at<float>(y, x) = y % 2 == 0 ? along : static_cast<float>(kWidth) - along;
        map_y_.at<float>(y, x) = 0.85f * static_cast<float>(line) + 0.02f * static_cast<float>(line % 3 * x) - 0.3f;
      }
    }
    cv::convertMaps(map_x_, map_y_, xy_, fraction_, CV_16SC2, false);
  }

  template <class T, class Kernel>
  cv::Mat Run(const cv::Mat& raw, Kernel kernel) const {
    cv::Mat out(xy_.size(), raw.type());
    const RawImage<T> image = {raw.ptr<T>(), static_cast<std::ptrdiff_t>(raw.step1()), raw.cols, raw.rows};
    for (int y = 0; y < out.rows; ++y) {
      kernel(image, xy_.ptr<std::int16_t>(y), fraction_.ptr<std::uint16_t>(y), out.cols, out.ptr<T>(y));
    }
    return out;
  }

  const UndistortKernels& kernels_ = UndistortKernelsFor(GetParam());
  cv::Mat raw_, map_x_, map_y_, xy_, fraction_;
};

TEST_P(UndistortKernel, BytesAreThoseOfOpenCv) {
  cv::Mat want;
  cv::remap(raw_, want, xy_, fraction_, cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar());
  EXPECT_EQ(cv::norm(want, Run<std::uint8_t>(raw_, kernels_.bytes), cv::NORM_INF), 0.0);
}

TEST_P(UndistortKernel, FloatsAreThoseOfOpenCvWithinRounding) {
  cv::Mat raw, want;
  raw_.convertTo(raw, CV_32F, 1.37);
  cv::remap(raw, want, xy_, fraction_, cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar());
  EXPECT_LT(cv::norm(want, Run<float>(raw, kernels_.floats), cv::NORM_INF), 1e-3);
}

TEST_P(UndistortKernel, AViewIntoALargerImageIsAnImage) {
  const cv::Mat view = raw_(cv::Rect(5, 3, 50, 30));
  EXPECT_EQ(
      cv::norm(Run<std::uint8_t>(view.clone(), kernels_.bytes), Run<std::uint8_t>(view, kernels_.bytes), cv::NORM_INF),
      0.0);
}

INSTANTIATE_TEST_SUITE_P(AllLevels, UndistortKernel, ::testing::ValuesIn(SupportedSimdLevels()),
                         [](const auto& level) { return std::string(ToString(level.param)); });

}  // namespace
}  // namespace cairn::image

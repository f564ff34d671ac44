/// \file
/// For users of Eigen and OpenCV: their types from the library's, and back. Nothing here is in the library: each half
/// is there if the compiler finds Eigen or OpenCV.
#pragma once

#include "cairn/export.h"
#include "cairn/image_view.h"
#include "cairn/pose.h"
#include "cairn/status.h"

#if __has_include(<Eigen/Geometry>)
#include <Eigen/Core>
#include <Eigen/Geometry>

CAIRN_BEGIN_NAMESPACE

/// a_from_b as a matrix.
inline Eigen::Isometry3d ToEigen(const Pose& a_from_b) {
  Eigen::Isometry3d result = Eigen::Isometry3d::Identity();
  result.linear() = Eigen::Quaterniond(Eigen::Map<const Eigen::Vector4d>(a_from_b.rotation_xyzw.data()))
                        .normalized()
                        .toRotationMatrix();
  result.translation() = Eigen::Map<const Eigen::Vector3d>(a_from_b.translation.data());
  return result;
}

/// The inverse of ToEigen().
inline Pose PoseFromEigen(const Eigen::Isometry3d& a_from_b) {
  Pose result;
  const Eigen::Quaterniond rotation = Eigen::Quaterniond(a_from_b.linear()).normalized();
  Eigen::Map<Eigen::Vector4d>(result.rotation_xyzw.data()) = rotation.coeffs();
  Eigen::Map<Eigen::Vector3d>(result.translation.data()) = a_from_b.translation();
  return result;
}

/// a_from_b as a matrix, with its scale.
inline Eigen::Affine3d ToEigen(const Similarity& a_from_b) {
  Eigen::Affine3d result(ToEigen(a_from_b.pose).matrix());
  result.linear() *= a_from_b.scale;
  return result;
}

/// The same 6x6 numbers.
inline Eigen::Matrix<double, 6, 6> ToEigen(const PoseCovariance& covariance) {
  return Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(covariance.data());
}

CAIRN_END_NAMESPACE
#endif

#if __has_include(<opencv2/core.hpp>)
#include <opencv2/core.hpp>

CAIRN_BEGIN_NAMESPACE

/// The pixels of `image`, not copied: it must stay as it is while the view is used. Three channels are taken to be
/// blue, green, red unless `color` says otherwise. kInvalidArgument if it is neither CV_8UC1 nor CV_8UC3, or empty.
inline absl::StatusOr<ImageView> ViewOf(const cv::Mat& image, PixelFormat color = PixelFormat::kBgr8) {
  if (image.empty() || image.dims != 2 || (image.type() != CV_8UC1 && image.type() != CV_8UC3)) {
    return absl::InvalidArgumentError("the image must be CV_8UC1 or CV_8UC3 and not empty");
  }
  ImageView view;
  view.data = image.ptr();
  view.width_px = image.cols;
  view.height_px = image.rows;
  view.stride_bytes = static_cast<std::ptrdiff_t>(image.step[0]);
  view.format = image.channels() == 1 ? PixelFormat::kGray8 : color;
  return view;
}

CAIRN_END_NAMESPACE
#endif

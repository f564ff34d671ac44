#include "direct/feature_start.h"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "absl/status/status.h"
#include "absl/strings/str_format.h"
#include "direct/feature_start_support.h"

namespace cairn::direct {
namespace {

constexpr int kLevels = 4;
const cv::Size kWindow(21, 21);
constexpr double kEssentialThresholdPx = 1.0;
constexpr double kMaxLostShare = 0.6;  // of the corners: the reference moves on
constexpr int kMaxReferenceFrames = 90;
constexpr double kPlaneShare = 0.95;  // homography inliers over essential inliers
constexpr int kMaxMisfits = 2;        // then the reference moves on: tracks only get worse

Matrix3d ToEigen(const cv::Mat& m) {
  Matrix3d e;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) e(r, c) = m.at<double>(r, c);
  }
  return e;
}

// The rotation that best takes rays of the reference to rays of the view (Kabsch), twice reweighted.
Matrix3d BestRotation(const std::vector<Vector3d>& from, const std::vector<Vector3d>& to) {
  Matrix3d rotation = Matrix3d::Identity();
  std::vector<double> weight(from.size(), 1.0);
  for (int round = 0; round < 5; ++round) {
    Matrix3d sum = Matrix3d::Zero();
    for (std::size_t i = 0; i < from.size(); ++i) sum += weight[i] * to[i] * from[i].transpose();
    const Eigen::JacobiSVD<Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Vector3d signs(1.0, 1.0, (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0);
    rotation = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
    for (std::size_t i = 0; i < from.size(); ++i) {
      weight[i] = 1.0 / std::max((rotation * from[i] - to[i]).norm(), 2e-3);
    }
  }
  return rotation;
}

// Motions of unit length by the essential matrix and, where one homography explains nearly as many corners, by it.
absl::Status TwoViewMotions(const Pinhole& camera, const std::vector<cv::Point2f>& from,
                            const std::vector<cv::Point2f>& to, std::vector<SE3>* motions, bool* plane) {
  try {
    const cv::Mat k = (cv::Mat_<double>(3, 3) << camera.fx_px, 0, camera.cx_px, 0, camera.fy_px, camera.cy_px, 0, 0, 1);
    cv::Mat inliers, r, t, plane_inliers;
    const cv::Mat essential = cv::findEssentialMat(from, to, k, cv::RANSAC, 0.9999, kEssentialThresholdPx, inliers);
    if (essential.rows < 3 || essential.cols != 3) return absl::NotFoundError("no essential matrix fits the corners");
    const int essential_inliers = cv::countNonZero(inliers);
    cv::recoverPose(essential.rowRange(0, 3), from, to, k, r, t, inliers);
    motions->emplace_back(ToEigen(r), Vector3d(t.at<double>(0), t.at<double>(1), t.at<double>(2)));
    const cv::Mat homography = cv::findHomography(from, to, cv::RANSAC, 1.5 * kEssentialThresholdPx, plane_inliers);
    *plane = !homography.empty() && cv::countNonZero(plane_inliers) > kPlaneShare * essential_inliers;
    if (!*plane) return absl::OkStatus();
    std::vector<cv::Mat> rotations, translations, normals;
    cv::decomposeHomographyMat(homography, k, rotations, translations, normals);
    for (std::size_t i = 0; i < rotations.size(); ++i) {
      const Vector3d shift(translations[i].at<double>(0), translations[i].at<double>(1), translations[i].at<double>(2));
      if (shift.norm() > 1e-6) motions->emplace_back(ToEigen(rotations[i]), shift.normalized());
    }
  } catch (const cv::Exception& error) {
    return absl::InternalError(absl::StrCat("two-view geometry failed: ", error.what()));
  }
  return absl::OkStatus();
}

}  // namespace

FeatureStart::FeatureStart(const OdometryOptions& options, const Pinhole& camera)
    : options_(options), camera_(camera) {}

void FeatureStart::Reset() {
  tracks_.clear();
  alive_.clear();
  reference_pyramid_.clear();
  last_pyramid_.clear();
}

void FeatureStart::SetReference(const cv::Mat& gray) {
  tracks_.clear();
  std::vector<cv::Point2f> corners;
  const double spacing_px =
      std::max(5.0, 0.35 * std::sqrt(static_cast<double>(gray.total()) / options_.start_features));
  cv::goodFeaturesToTrack(gray, corners, options_.start_features, 0.005, spacing_px, cv::noArray(), 5);
  alive_.assign(corners.size(), true);
  first_count_ = static_cast<int>(corners.size());
  tracks_.push_back(std::move(corners));
  cv::buildOpticalFlowPyramid(gray, reference_pyramid_, kWindow, kLevels);
  last_pyramid_ = reference_pyramid_;
  last_attempt_parallax_rad_ = 0.0;
  misfits_ = 0;
}

bool FeatureStart::Follow(const cv::Mat& gray) {
  std::vector<cv::Mat> pyramid;
  cv::buildOpticalFlowPyramid(gray, pyramid, kWindow, kLevels);
  const std::vector<cv::Point2f>& last = tracks_.back();
  std::vector<int> index;
  std::vector<cv::Point2f> from, first;
  for (std::size_t i = 0; i < alive_.size(); ++i) {
    if (!alive_[i]) continue;
    index.push_back(static_cast<int>(i));
    from.push_back(last[i]);
    first.push_back(tracks_.front()[i]);
  }
  std::vector<cv::Point2f> next = last;
  if (!from.empty()) {
    std::vector<cv::Point2f> to, back, direct;
    std::vector<unsigned char> found, found_back, found_direct;
    std::vector<float> error;
    const cv::TermCriteria stop(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 0.01);
    cv::calcOpticalFlowPyrLK(last_pyramid_, pyramid, from, to, found, error, kWindow, kLevels, stop);
    back = from;
    cv::calcOpticalFlowPyrLK(pyramid, last_pyramid_, to, back, found_back, error, kWindow, 1, stop,
                             cv::OPTFLOW_USE_INITIAL_FLOW);
    // Against the reference itself, so that small errors do not add up; only where it agrees.
    direct = to;
    cv::calcOpticalFlowPyrLK(reference_pyramid_, pyramid, first, direct, found_direct, error, kWindow, 1, stop,
                             cv::OPTFLOW_USE_INITIAL_FLOW);
    for (std::size_t k = 0; k < index.size(); ++k) {
      const auto distance = [](const cv::Point2f& a, const cv::Point2f& b) { return std::hypot(a.x - b.x, a.y - b.y); };
      const bool inside = to[k].x > 8 && to[k].y > 8 && to[k].x < static_cast<float>(gray.cols) - 9.0f &&
                          to[k].y < static_cast<float>(gray.rows) - 9.0f;
      if (!found[k] || !found_back[k] || !inside || distance(back[k], from[k]) > 0.7f) {
        alive_[index[k]] = false;
        continue;
      }
      next[index[k]] = found_direct[k] && distance(direct[k], to[k]) < 1.5f ? direct[k] : to[k];
    }
  }
  tracks_.push_back(std::move(next));
  last_pyramid_ = std::move(pyramid);
  return std::count(alive_.begin(), alive_.end(), true) >= options_.start_min_features;
}

StartResult FeatureStart::Add(const Frame& frame) {
  StartResult result;
  cv::Mat gray = frame.image;
  if (tracks_.empty()) {
    SetReference(gray);
    result.new_reference = true;
    result.message = first_count_ < options_.start_min_features
                         ? absl::StrFormat("too little texture: %d corners, at least %d are needed", first_count_,
                                           options_.start_min_features)
                         : "waiting for the camera to move";
    if (first_count_ < options_.start_min_features) Reset();
    return result;
  }
  const bool enough = Follow(gray);
  const int alive = static_cast<int>(std::count(alive_.begin(), alive_.end(), true));
  if (enough) {
    result = Solve();
    if (result.success) {
      solved_count_ = alive;
      return result;
    }
  } else {
    result.message = absl::StrFormat("lost the corners it followed: %d of %d are left", alive, first_count_);
  }
  const bool lost_many = alive < (1.0 - kMaxLostShare) * first_count_;
  misfits_ += result.misfit;
  if (!enough || lost_many || misfits_ >= kMaxMisfits || FrameCount() >= kMaxReferenceFrames) {
    SetReference(gray);
    result.new_reference = true;
    if (first_count_ < options_.start_min_features) Reset();
  }
  return result;
}

bool FeatureStart::Continue(const Frame& frame) {
  return Follow(frame.image) && 2 * std::count(alive_.begin(), alive_.end(), true) >= solved_count_;
}

StartResult FeatureStart::SolveAgain() {
  last_attempt_parallax_rad_ = 0.0;
  return Solve();
}

StartResult FeatureStart::Solve() {
  StartResult result;
  std::vector<int> alive;
  std::vector<cv::Point2f> from, to;
  std::vector<Vector3d> from_rays, to_rays;
  for (std::size_t i = 0; i < alive_.size(); ++i) {
    if (!alive_[i]) continue;
    alive.push_back(static_cast<int>(i));
    from.push_back(tracks_.front()[i]);
    to.push_back(tracks_.back()[i]);
    from_rays.push_back(camera_.Unproject({from.back().x, from.back().y}).normalized());
    to_rays.push_back(camera_.Unproject({to.back().x, to.back().y}).normalized());
  }
  const Matrix3d rotation = BestRotation(from_rays, to_rays);
  std::vector<double> angles;
  for (std::size_t i = 0; i < from_rays.size(); ++i) angles.push_back(Angle(rotation * from_rays[i], to_rays[i]));
  const double flow_rad = Median(angles);
  const double wanted_rad = options_.start_min_parallax_deg * std::numbers::pi / 180.0;
  result.parallax_rad = flow_rad;
  // The best rotation hides part of the parallax: half of it already is worth a try.
  if (flow_rad < 0.4 * wanted_rad) {
    result.message = absl::StrFormat(
        "the camera has not moved enough: %.2f deg of parallax once rotation is taken out, waiting for about %.2f deg",
        flow_rad * 180.0 / std::numbers::pi, 0.5 * options_.start_min_parallax_deg);
    return result;
  }
  if (flow_rad < 1.1 * last_attempt_parallax_rad_) {
    result.message =
        absl::StrFormat("waiting for more motion: %.2f deg of parallax", flow_rad * 180.0 / std::numbers::pi);
    return result;
  }
  last_attempt_parallax_rad_ = flow_rad;

  std::vector<SE3> candidates;
  bool plane = false;
  const absl::Status two_views = TwoViewMotions(camera_, from, to, &candidates, &plane);
  if (!two_views.ok()) {
    result.message = std::string(two_views.message());
    return result;
  }
  // Small motions have minima that two-view geometry does not show: from all sides.
  for (int code = 0; code < 27; ++code) {
    const int x = code % 3 - 1, y = code / 3 % 3 - 1, z = code / 9 - 1;
    const Vector3d side(x, y, z);
    if (side.squaredNorm() > 0.5) candidates.emplace_back(rotation, side.normalized());
  }
  // Views for the adjustment: evenly spread, the newest last.
  const int frames = FrameCount() - 1;
  std::vector<int> views;
  const int count = std::min(frames, kMaxStartViews);
  for (int i = 1; i <= count; ++i) views.push_back((i * frames) / count);

  return Choose(candidates, alive, views, plane, flow_rad);
}

}  // namespace cairn::direct

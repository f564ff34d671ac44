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
#include "direct/structure_adjustment.h"

namespace cairn::direct {
namespace {

constexpr int kLevels = 4;
const cv::Size kWindow(21, 21);
constexpr double kEssentialThresholdPx = 1.0;
constexpr double kMaxLostShare = 0.6;  // of the corners: the reference moves on
constexpr int kMaxReferenceFrames = 90;
constexpr int kMaxViews = 12;                // in the bundle adjustment
constexpr double kPlaneShare = 0.95;         // homography inliers over essential inliers
constexpr double kAmbiguousCostRatio = 1.3;  // between two different solutions
constexpr double kSameDirection = 0.95;      // cosine between two motions that are one
constexpr std::size_t kPairPoints = 120;     // corners that a two-view minimum is searched with
constexpr double kMaxPairCostRatio = 2.5;    // of the two-view minima that are looked at more closely ...
constexpr std::size_t kMaxMinima = 6;        // ... and how many at most
constexpr int kMaxMisfits = 2;               // then the reference moves on: tracks only get worse
constexpr double kOutlierCostPx2 = 4.0;      // of a corner that does not fit: the limit of one that does
constexpr double kMaxMedianDepthSigma = 0.25;

Matrix3d ToEigen(const cv::Mat& m) {
  Matrix3d e;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) e(r, c) = m.at<double>(r, c);
  }
  return e;
}

double Median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
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

double Angle(const Vector3d& a, const Vector3d& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

// Mean squared error of all corners, those that do not fit at the limit of those that do.
double Cost(const StructureReport& report) {
  return report.inlier_share * report.rms_px * report.rms_px + (1.0 - report.inlier_share) * kOutlierCostPx2;
}

double TriangulateInverseDepth(const Vector3d& reference_ray, const Vector3d& view_ray, const SE3& pose) {
  // view_ray x (R ray + id t) = 0, least squares in id.
  const Vector3d a = view_ray.cross(pose.translation());
  const Vector3d b = view_ray.cross(pose.rotation() * reference_ray);
  const double aa = a.squaredNorm();
  return aa > 1e-12 ? -a.dot(b) / aa : 0.0;
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

double FeatureStart::CostOf(const std::vector<std::optional<SE3>>& camera_from_reference) const {
  StructureProblem problem;
  problem.camera = camera_;
  std::vector<int> frames;
  for (int f = 1; f < FrameCount(); ++f) {
    if (camera_from_reference[f]) frames.push_back(f);
  }
  if (frames.empty()) return 1e300;
  const int known = static_cast<int>(frames.size()), count = std::min(known, kMaxViews);
  for (int v = 1; v <= count; ++v) {
    const int f = frames[(v * known) / count - 1];
    problem.camera_from_reference.push_back(*camera_from_reference[f]);
    problem.observed_px.emplace_back();
    for (std::size_t i = 0; i < alive_.size(); ++i) {
      if (alive_[i]) problem.observed_px.back().emplace_back(tracks_[f][i].x, tracks_[f][i].y);
    }
  }
  for (std::size_t i = 0; i < alive_.size(); ++i) {
    if (!alive_[i]) continue;
    const Vector2d first(tracks_.front()[i].x, tracks_.front()[i].y);
    const Vector2d& last = problem.observed_px.back()[problem.reference_px.size()];
    problem.reference_px.push_back(first);
    problem.inverse_depth.push_back(TriangulateInverseDepth(camera_.Unproject(first), camera_.Unproject(last),
                                                            problem.camera_from_reference.back()));
  }
  if (static_cast<int>(problem.reference_px.size()) < options_.start_min_features) return 1e300;
  return Cost(AdjustDepths(5, &problem));
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
  const int count = std::min(frames, kMaxViews);
  for (int i = 1; i <= count; ++i) views.push_back((i * frames) / count);

  return Choose(candidates, alive, views, plane, flow_rad);
}

// The motion that fits best, unless another one fits about as well.
StartResult FeatureStart::Choose(const std::vector<SE3>& candidates, const std::vector<int>& alive,
                                 const std::vector<int>& views, bool plane, double flow_rad) {
  const double same_rad = 0.5 * options_.start_min_parallax_deg * std::numbers::pi / 180.0;
  const auto same = [&](const SE3& a, const SE3& b) {
    return AngleRad(a.rotation() * b.rotation().conjugate()) < same_rad &&
           a.translation().normalized().dot(b.translation().normalized()) > kSameDirection;
  };
  struct Minimum {
    SE3 pose;
    double cost;
  };
  std::vector<Minimum> found, minima;
  for (const SE3& candidate : candidates) {
    Minimum minimum = {candidate, 0.0};
    if (RefinePair(alive, &minimum.pose, &minimum.cost)) found.push_back(minimum);
  }
  std::stable_sort(found.begin(), found.end(), [](const Minimum& a, const Minimum& b) { return a.cost < b.cost; });
  for (const Minimum& minimum : found) {
    if (minimum.cost > kMaxPairCostRatio * found.front().cost || minima.size() == kMaxMinima) break;
    const auto is_same = [&](const Minimum& other) { return same(minimum.pose, other.pose); };
    if (std::none_of(minima.begin(), minima.end(), is_same)) minima.push_back(minimum);
  }
  StartResult result;
  result.message = "the corners do not lie in front of both cameras";
  result.parallax_rad = flow_rad;
  std::vector<StartResult> trials;
  for (const Minimum& minimum : minima) trials.push_back(Reconstruct(minimum.pose, alive, views));
  if (trials.empty()) return result;
  auto best = std::min_element(trials.begin(), trials.end(),
                               [](const StartResult& a, const StartResult& b) { return a.cost < b.cost; });
  const bool ambiguous = std::any_of(trials.begin(), trials.end(), [&](const StartResult& other) {
    return !other.camera_from_reference.empty() && other.cost < kAmbiguousCostRatio * best->cost &&
           !same(other.camera_from_reference.back(), best->camera_from_reference.back());
  });
  result = std::move(*best);
  if (result.success && ambiguous) {
    result.success = false;
    result.message = plane ? "the corners lie on one plane and two motions explain them: waiting for a different view"
                           : "two motions explain the corners: waiting for more motion";
  }
  result.parallax_rad = std::max(result.parallax_rad, flow_rad);
  return result;
}

// The two-view minimum that a motion leads to, over some of the corners; false if it has none in front of the cameras.
bool FeatureStart::RefinePair(const std::vector<int>& alive, SE3* pose, double* cost) {
  StructureProblem problem;
  problem.camera = camera_;
  problem.observed_px.resize(1);
  const std::size_t step = std::max<std::size_t>(1, alive.size() / kPairPoints);
  for (std::size_t k = 0; k < alive.size(); k += step) {
    const int i = alive[k];
    const Vector2d first(tracks_.front()[i].x, tracks_.front()[i].y), now(tracks_.back()[i].x, tracks_.back()[i].y);
    problem.reference_px.push_back(first);
    problem.observed_px[0].push_back(now);
    problem.inverse_depth.push_back(TriangulateInverseDepth(camera_.Unproject(first), camera_.Unproject(now), *pose));
  }
  const double median = Median(problem.inverse_depth);
  if (!(median > 0.0)) return false;
  for (double& d : problem.inverse_depth) d = std::clamp(d / median, 0.01, 10.0);
  problem.camera_from_reference.emplace_back(pose->rotation(), pose->translation() * median);
  const StructureReport report = AdjustStructure(30, &problem);
  *pose = problem.camera_from_reference.front();
  *cost = Cost(report);
  const double length = pose->translation().norm();
  if (!(length > 1e-12) || !(Median(problem.inverse_depth) > 0.0)) return false;
  pose->translation() /= length;
  return true;
}

// A bundle adjustment over the views, from the two-view minimum on, and the poses of all frames.
StartResult FeatureStart::Reconstruct(const SE3& pose, const std::vector<int>& alive, const std::vector<int>& views) {
  StartResult result;
  StructureProblem problem;
  problem.camera = camera_;
  std::vector<Vector2d> last;
  for (int i : alive) {
    const Vector2d first(tracks_.front()[i].x, tracks_.front()[i].y);
    const Vector2d now(tracks_.back()[i].x, tracks_.back()[i].y);
    problem.reference_px.push_back(first);
    last.push_back(now);
    problem.inverse_depth.push_back(TriangulateInverseDepth(camera_.Unproject(first), camera_.Unproject(now), pose));
  }
  const double median = Median(problem.inverse_depth);
  if (!(median > 0.0)) {
    result.message = "the corners do not lie in front of both cameras";
    return result;
  }
  for (double& d : problem.inverse_depth) d = std::clamp(d / median, 0.01, 10.0);
  const auto observe = [&](int frame) {
    std::vector<Vector2d> observed;
    for (int i : alive) observed.emplace_back(tracks_[frame][i].x, tracks_[frame][i].y);
    return observed;
  };
  // Two views first, then the views between from the newest back to the reference.
  problem.observed_px.push_back(last);
  problem.camera_from_reference.emplace_back(pose.rotation(), pose.translation() * median);
  AdjustStructure(15, &problem);
  SE3 guess = problem.camera_from_reference.front();
  std::vector<SE3> poses(views.size());
  std::vector<std::vector<Vector2d>> observed(views.size());
  for (int v = static_cast<int>(views.size()) - 1; v >= 0; --v) {
    observed[v] = observe(views[v]);
    AlignView(problem, observed[v], 10, &guess);
    poses[v] = guess;
  }
  problem.camera_from_reference = poses;
  problem.observed_px = observed;
  StructureReport report = AdjustStructure(20, &problem);
  // Once more with the inliers only.
  StructureProblem clean;
  clean.camera = camera_;
  clean.camera_from_reference = problem.camera_from_reference;
  clean.observed_px.resize(views.size());
  for (std::size_t p = 0; p < alive.size(); ++p) {
    if (!report.inlier[p]) continue;
    clean.reference_px.push_back(problem.reference_px[p]);
    clean.inverse_depth.push_back(problem.inverse_depth[p]);
    for (std::size_t v = 0; v < views.size(); ++v) clean.observed_px[v].push_back(observed[v][p]);
  }
  const double share = report.inlier_share;
  if (static_cast<int>(clean.inverse_depth.size()) < options_.start_min_features) {
    result.message = absl::StrFormat("only %d of the corners agree on one motion, at least %d are needed",
                                     clean.inverse_depth.size(), options_.start_min_features);
    return result;
  }
  report = AdjustStructure(20, &clean);
  std::vector<double> parallax, sigma;
  const SE3& newest = clean.camera_from_reference.back();
  const Vector3d centre = newest.Inverse().translation();
  for (std::size_t p = 0; p < clean.inverse_depth.size(); ++p) {
    const Vector3d ray = camera_.Unproject(clean.reference_px[p]);
    parallax.push_back(Angle(ray, ray - std::max(clean.inverse_depth[p], 0.0) * centre));
    sigma.push_back(report.relative_depth_sigma[p]);
  }
  result.parallax_rad = Median(parallax);
  result.rms_px = report.rms_px;
  report.inlier_share = share;
  result.cost = Cost(report);
  // Median inverse depth 1; poses of the frames that were not adjusted.
  std::vector<double> depths;
  for (std::size_t p = 0; p < clean.inverse_depth.size(); ++p) {
    if (report.inlier[p]) depths.push_back(clean.inverse_depth[p]);
  }
  const double scale = Median(depths);
  for (SE3& view : clean.camera_from_reference) view.translation() *= scale;
  for (double& d : clean.inverse_depth) d /= scale;
  result.camera_from_reference.assign(tracks_.size(), SE3());
  std::vector<int> clean_index;
  for (std::size_t p = 0; p < alive.size(); ++p) {
    bool used = false;
    for (std::size_t q = 0; q < clean.reference_px.size() && !used; ++q) {
      used = clean.reference_px[q] == Vector2d(tracks_.front()[alive[p]].x, tracks_.front()[alive[p]].y);
    }
    if (used) clean_index.push_back(alive[p]);
  }
  guess = SE3();
  std::size_t next_view = 0;
  for (int f = 1; f < FrameCount(); ++f) {
    if (next_view < views.size() && views[next_view] == f) {
      guess = clean.camera_from_reference[next_view++];
    } else {
      std::vector<Vector2d> seen;
      for (int i : clean_index) seen.emplace_back(tracks_[f][i].x, tracks_[f][i].y);
      AlignView(clean, seen, 10, &guess);
    }
    result.camera_from_reference[f] = guess;
  }
  for (std::size_t p = 0; p < clean.inverse_depth.size(); ++p) {
    if (!report.inlier[p]) continue;
    result.reference_px.push_back(clean.reference_px[p]);
    result.inverse_depth.push_back(clean.inverse_depth[p]);
  }
  if (share < options_.start_min_inlier_share) {
    result.misfit = true;
    result.message = absl::StrFormat("only %.0f %% of the corners agree on one motion, at least %.0f %% are needed",
                                     100.0 * share, 100.0 * options_.start_min_inlier_share);
    return result;
  }
  if (report.rms_px > options_.start_max_reprojection_px) {
    result.misfit = true;
    result.message = absl::StrFormat("the reconstruction does not fit: %.2f px, at most %.2f px", report.rms_px,
                                     options_.start_max_reprojection_px);
    return result;
  }
  if (result.parallax_rad < options_.start_min_parallax_deg * std::numbers::pi / 180.0 ||
      Median(sigma) > kMaxMedianDepthSigma) {
    result.message = absl::StrFormat("the camera has not moved enough: %.2f deg of parallax, %.2f deg are needed",
                                     result.parallax_rad * 180.0 / std::numbers::pi, options_.start_min_parallax_deg);
    return result;
  }
  result.success = true;
  return result;
}

}  // namespace cairn::direct

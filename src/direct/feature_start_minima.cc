// Which motion explains the corners: the search for the minima of two-view geometry, and the bundle adjustment that
// tells them apart. The second half of feature_start.h.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "absl/strings/str_format.h"
#include "direct/feature_start.h"
#include "direct/feature_start_support.h"
#include "direct/structure_adjustment.h"

namespace cairn::direct {
namespace {

constexpr double kAmbiguousCostRatio = 1.3;  // between two different solutions
constexpr double kSameDirection = 0.95;      // cosine between two motions that are one
constexpr std::size_t kPairPoints = 120;     // corners that a two-view minimum is searched with
constexpr double kMaxPairCostRatio = 2.5;    // of the two-view minima that are looked at more closely ...
constexpr std::size_t kMaxMinima = 6;        // ... and how many at most
constexpr double kOutlierCostPx2 = 4.0;      // of a corner that does not fit: the limit of one that does
constexpr double kMaxMedianDepthSigma = 0.25;

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

}  // namespace

double FeatureStart::CostOf(const std::vector<std::optional<SE3>>& camera_from_reference) const {
  const std::optional<StructureReport> report = Explain(camera_from_reference);
  return report ? Cost(*report) : 1e300;
}

double FeatureStart::InlierRmsPxOf(const std::vector<std::optional<SE3>>& camera_from_reference) const {
  const std::optional<StructureReport> report = Explain(camera_from_reference);
  return report ? report->rms_px : 0.0;
}

// With the best depths; nothing where too few corners are left.
std::optional<StructureReport> FeatureStart::Explain(
    const std::vector<std::optional<SE3>>& camera_from_reference) const {
  StructureProblem problem;
  problem.camera = camera_;
  std::vector<int> frames;
  for (int f = 1; f < FrameCount(); ++f) {
    if (camera_from_reference[f]) frames.push_back(f);
  }
  if (frames.empty()) return std::nullopt;
  const int known = static_cast<int>(frames.size()), count = std::min(known, kMaxStartViews);
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
  if (static_cast<int>(problem.reference_px.size()) < options_.start_min_features) return std::nullopt;
  return AdjustDepths(5, &problem);
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
  if (result.parallax_rad > 0.0) result.misfit_share = result.rms_px / (camera_.fx_px * result.parallax_rad);
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

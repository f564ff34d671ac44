#include "tracking/pose_attempt.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "optimization/focal_estimate.h"
#include "tracking/calibration_search.h"
#include "tracking/view_support.h"

namespace cairn::tracking {
namespace {

using optimization::PoseObservation;

// Where fewer than so many of the matches agree with the pose, another calibration is looked for.
constexpr double kExplained = 0.5;
constexpr double kExplainedInDoubt = 0.8;  // likewise, where those around it are not quite those of its calibration
// If none is found, the matches around the pose, which agree with it by their choice, do not tell the focal length
// better than so much (of its logarithm).
constexpr double kUnexplainedSigma = 0.04;
// Another calibration that is nearer than this, of the logarithm of the focal length and of the image's longer side, is
// the same: maps that are bent a little let some matches more agree with one next to the right one (within 0.031 and
// 0.02 in 50 of 108 images of a real kitchen; docs/benchmarks.md, "What was saved").
constexpr double kSameLogFocal = 4 * optimization::kUsualFocalError;
constexpr double kSamePrincipal = 2 * optimization::kUsualPrincipalError;
constexpr int kCalibrationRounds = 3;
constexpr double kConvergedLogFocal = 0.01;
constexpr double kViewMargin = 0.15;  // around the image, share of its width

void Miss(RelocalizationStage stage, std::string reason, Relocalization* attempt) {
  attempt->stage = stage;
  attempt->reason = std::move(reason);
}

// The pose while guided search works on it, and what supports it.
struct Estimate {
  SE3 camera_from_map;
  Matrix6d covariance = Matrix6d::Zero();  // of camera_from_map
  std::vector<PointObservation> inliers;
  std::vector<PoseObservation> observations;  // all matches of the last round
  MapFit fit;
};

std::vector<PointId> PointsOf(const std::vector<PointObservation>& observations) {
  std::vector<PointId> points;
  for (const PointObservation& observation : observations) points.push_back(observation.point);
  return points;
}

ProjectionOptions GuidedProjection(const RelocalizerOptions& options, double radius_factor) {
  ProjectionOptions projection;
  projection.radius_factor = radius_factor;
  projection.max_distance = options.guided_max_distance;
  projection.max_ratio = options.guided_max_ratio;
  projection.max_viewing_angle_deg = options.guided_max_viewing_angle_deg;
  projection.distance_slack = options.guided_distance_slack;
  return projection;
}

// The points of the local map that may be in view, with a margin for what the pose may still change. By id.
struct GuidedPoints {
  std::vector<const map::MapPoint*> points;
  DescriptorLists descriptors;
};

// The descriptors of those that were around before are taken from there: they lie together.
DescriptorLists DescriptorsOf(const ImageQuery& query, std::span<const map::MapPoint* const> points,
                              int descriptors_per_point, const GuidedPoints& before) {
  constexpr auto kNew = ~std::size_t{0};
  std::vector<std::size_t> places(points.size(), kNew);  // before
  std::vector<const map::MapPoint*> added;
  for (std::size_t i = 0, at = 0; i < points.size(); ++i) {
    while (at < before.points.size() && before.points[at]->id < points[i]->id) ++at;
    if (at < before.points.size() && before.points[at] == points[i]) {
      places[i] = at;
    } else {
      added.push_back(points[i]);
    }
  }
  DescriptorLists of_added = ObservedDescriptors(query.map, added, descriptors_per_point);
  if (before.points.empty()) return of_added;
  DescriptorLists lists;
  lists.descriptors.reserve(before.descriptors.descriptors.size() + of_added.descriptors.size());
  for (std::size_t i = 0, next = 0; i < points.size(); ++i) {
    const auto list = places[i] == kNew ? of_added.of(next++) : before.descriptors.of(places[i]);
    lists.descriptors.insert(lists.descriptors.end(), list.begin(), list.end());
    lists.Close();
  }
  return lists;
}

GuidedPoints PointsAround(const ImageQuery& query, const RelocalizerOptions& options, const Estimate& estimate,
                          const GuidedPoints& before) {
  const LocalMap local = LocalMapOfPoints(query.map, PointsOf(estimate.inliers), options.local_map);
  GuidedPoints around;
  for (const map::MapPoint* point : local.points) {
    const Vector3d point_c = estimate.camera_from_map * point->position;
    if (!(point_c.z() > 1e-9)) continue;
    if (!query.pinhole.Contains(query.pinhole.Project(point_c), -kViewMargin * query.pinhole.width_px)) continue;
    around.points.push_back(point);
  }
  around.descriptors = DescriptorsOf(query, around.points, options.descriptors_per_point, before);
  return around;
}

// Of the cells where points should be in view, those that show some.
void CountCells(const ImageQuery& query, const Estimate& estimate, const GuidedPoints& around,
                std::span<const std::uint32_t> visible, RelocalizationCounts* counts) {
  ViewSupport support(query.pinhole);
  for (const PointObservation& inlier : estimate.inliers) {
    const image::Keypoint& keypoint = query.features.keypoints[inlier.feature];
    support.Find({keypoint.x_px, keypoint.y_px});
  }
  for (const std::uint32_t i : visible) {
    const Vector3d point_c = estimate.camera_from_map * around.points[i]->position;
    if (optimization::InFront(point_c)) support.Expect(query.pinhole.Project(point_c));
  }
  counts->cells = support.cells();
  counts->visible_cells = support.visible_cells();
}

double Support(const RelocalizationCounts& counts) { return ViewSupport::ShareOf(counts.cells, counts.visible_cells); }

// One round of guided search and refinement. False if the refinement fails.
bool GuidedRound(const ImageQuery& query, const RelocalizerOptions& options, double radius_factor,
                 const GuidedPoints& around, Estimate* estimate, RelocalizationCounts* counts) {
  const ProjectionMatches found =
      MatchByProjection({query.pinhole, query.features, query.grid}, estimate->camera_from_map, around.points,
                        query.map.info().orb, GuidedProjection(options, radius_factor), {}, &around.descriptors);
  counts->guided_matches = static_cast<int>(found.matches.size());
  counts->visible = static_cast<int>(found.visible.size());

  std::vector<PoseObservation> observations;
  for (const PointMatch& match : found.matches) {
    observations.push_back(query.Observation(around.points[match.point]->position, match.feature));
  }
  const auto refined = optimization::RefinePose(query.pinhole, estimate->camera_from_map, observations);
  if (!refined.ok()) return false;
  estimate->camera_from_map = refined->camera_from_map;
  estimate->covariance = refined->covariance;
  estimate->fit.residual_rms = std::sqrt(refined->chi2 / (2.0 * refined->num_inliers));
  estimate->inliers.clear();
  std::vector<double> depths;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (!refined->inlier[i]) continue;
    estimate->inliers.push_back({around.points[found.matches[i].point]->id, found.matches[i].feature});
    depths.push_back((refined->camera_from_map * observations[i].point).z());
  }
  std::nth_element(depths.begin(), depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2), depths.end());
  estimate->fit.median_depth = depths[depths.size() / 2];
  CountCells(query, *estimate, around, found.visible, counts);
  counts->inliers = static_cast<int>(estimate->inliers.size());
  estimate->observations = std::move(observations);
  return true;
}

// Empty if the evidence is enough, else what is missing.
std::string Objection(const Estimate& estimate, const RelocalizationCounts& counts, const Matrix6d& covariance,
                      const RelocalizerOptions& options) {
  if (counts.inliers < options.min_inliers) {
    return absl::StrCat(counts.inliers, " inliers of ", counts.visible, " points that should be in view, at least ",
                        options.min_inliers, " needed");
  }
  // By cells and not by points: a crowd of points on one object must not pass for the whole view.
  if (counts.cells < options.min_cells || Support(counts) < options.min_support) {
    return absl::StrCat(counts.inliers, " inliers, but points in only ", counts.cells, " of the ", counts.visible_cells,
                        " cells of the image that should show some: a place that looks like it");
  }
  const double position_sigma = std::sqrt(covariance.topLeftCorner<3, 3>().trace()) / estimate.fit.median_depth;
  if (!(position_sigma <= options.max_position_sigma)) {
    return absl::StrCat("the matches leave the position uncertain by ", position_sigma, " of the depth of the scene, ",
                        "at most ", options.max_position_sigma, " allowed");
  }
  const double rotation_sigma_deg = std::sqrt(covariance.bottomRightCorner<3, 3>().trace()) * 180.0 / std::numbers::pi;
  if (!(rotation_sigma_deg <= options.max_rotation_sigma_deg)) {
    return absl::StrCat("the matches leave the direction uncertain by ", rotation_sigma_deg, " degrees, at most ",
                        options.max_rotation_sigma_deg, " allowed");
  }
  return "";
}

// Beyond doubt: enough inliers nearly everywhere where points should be in view. An answer that is accepted with less
// may be one of several; then the other groups are tried, too.
bool IsStrong(const RelocalizationCounts& counts, const RelocalizerOptions& options) {
  return counts.inliers >= options.strong_inliers && Support(counts) >= options.strong_support;
}

KeyframeId ReferenceKeyframe(const map::Snapshot& map, const std::vector<PointObservation>& inliers) {
  return LocalMapOfPoints(map, PointsOf(inliers),
                          {.max_keyframes = 1, .neighbours_per_keyframe = 0, .tree_neighbours = false})
      .reference();
}

// Guided search around the pose of PnP. False if a refinement fails.
bool Guide(const ImageQuery& query, const RelocalizerOptions& options, Estimate* estimate,
           RelocalizationCounts* counts) {
  GuidedPoints around;
  for (std::size_t round = 0; round < options.guided_radius_factors.size(); ++round) {
    // The first round shows better than PnP what is in view; after the second that changes no more.
    if (round < 2) around = PointsAround(query, options, *estimate, around);
    if (!GuidedRound(query, options, options.guided_radius_factors[round], around, estimate, counts)) return false;
  }
  return true;
}

// The estimate against the calibration that the query came with, if it was made from another one.
optimization::FocalEstimate Against(const Pinhole& query, const Pinhole& start,
                                    const optimization::FocalEstimate& estimate) {
  const Pinhole corrected = estimate.Corrected(start);
  optimization::FocalEstimate total = estimate;
  total.scale = corrected.fx_px / query.fx_px;
  total.principal_shift = Vector2d(corrected.cx_px - query.cx_px, corrected.cy_px - query.cy_px) /
                          std::max(query.width_px, query.height_px);
  return total;
}

// Guided search with another calibration, which is estimated anew by what is found.
struct Recalibrated {
  optimization::FocalEstimate calibration;  // against the query's
  Estimate estimate;                        // with it
  RelocalizationCounts counts;
};

std::optional<Recalibrated> Recalibrate(const ImageQuery& query, const RelocalizerOptions& options,
                                        const Pinhole& start, Estimate estimate) {
  Recalibrated result;
  result.estimate = std::move(estimate);
  Pinhole pinhole = start;
  for (int round = 0; round < kCalibrationRounds; ++round) {
    const Pinhole tried = pinhole;
    const ImageQuery with{query.map, query.places, tried, query.features, query.grid, query.words};
    if (!Guide(with, options, &result.estimate, &result.counts)) return std::nullopt;
    const auto calibration =
        optimization::EstimateFocal(tried, result.estimate.camera_from_map, result.estimate.observations);
    if (!calibration.ok()) return std::nullopt;
    result.calibration = Against(query.pinhole, tried, *calibration);
    result.estimate.camera_from_map = calibration->camera_from_map;
    pinhole = calibration->Corrected(tried);
    if (std::abs(std::log(calibration->scale)) < kConvergedLogFocal) break;
  }
  return result;
}

Estimate StartOf(const OtherCalibration& other, std::span<const GroupMatch> matches) {
  Estimate estimate;
  estimate.camera_from_map = other.camera_from_map;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (other.inlier[i]) estimate.inliers.push_back({matches[i].point, matches[i].feature});
  }
  return estimate;
}

std::vector<PoseObservation> ObservationsOf(const ImageQuery& query, std::span<const GroupMatch> matches) {
  std::vector<PoseObservation> observations;
  for (const GroupMatch& match : matches) {
    observations.push_back(query.Observation(query.map.point(match.point).position, match.feature));
  }
  return observations;
}

// What the matches around the pose show if the principal point is the question, too.
absl::StatusOr<optimization::FocalEstimate> WithPrincipalPoint(const ImageQuery& query, const Estimate& estimate) {
  optimization::PoseRefinementOptions few;
  few.rounds = 2;
  few.iterations_per_round = 3;
  return optimization::EstimateFocal(query.pinhole, estimate.camera_from_map, estimate.observations, few,
                                     optimization::FocalPrior::WithPrincipalPoint());
}

// Another calibration that more of the matches agree with than with the one as it is.
std::optional<OtherCalibration> SearchRival(const ImageQuery& query, const RelocalizerOptions& options,
                                            std::span<const PoseObservation> all, const SE3& camera_from_map, int agree,
                                            bool from_anywhere) {
  auto other = SearchCalibration(query.pinhole, camera_from_map, all);
  // From a pose that is nowhere near, no way leads to the right one.
  if (from_anywhere && !(other && ManyMore(other->num_inliers, agree))) {
    auto elsewhere = SearchCalibration(query.pinhole, all, options.pnp);
    if (elsewhere && (!other || elsewhere->num_inliers > other->num_inliers)) other = std::move(elsewhere);
  }
  if (other && other->num_inliers <= agree) return std::nullopt;
  return other;
}

bool IsSame(const Pinhole& a, const Pinhole& b) {
  const double shift = std::hypot(a.cx_px - b.cx_px, a.cy_px - b.cy_px);
  return std::abs(std::log(a.fx_px / b.fx_px)) <= kSameLogFocal &&
         shift <= kSamePrincipal * std::max(a.width_px, a.height_px);
}

// What the image says of its calibration: by the matches around the pose, and, where these doubt it, or many of the
// others do not agree with the pose, by what another calibration finds.
std::optional<optimization::FocalEstimate> JudgeCalibration(const ImageQuery& query, const RelocalizerOptions& options,
                                                            std::span<const GroupMatch> matches,
                                                            const Estimate& estimate) {
  const auto own = optimization::EstimateFocal(query.pinhole, estimate.camera_from_map, estimate.observations);
  const auto wide = WithPrincipalPoint(query, estimate);
  const std::vector<PoseObservation> all = ObservationsOf(query, matches);
  const int agree = CountInliers(query.pinhole, estimate.camera_from_map, all);
  std::optional<optimization::FocalEstimate> doubted;
  if (own.ok() && own->Contradicts()) doubted = *own;
  if (wide.ok() && wide->PrincipalContradicts()) doubted = *wide;
  const double explained = static_cast<double>(agree) / static_cast<double>(all.size());
  const bool doubts = (own.ok() && own->Doubts()) || (wide.ok() && wide->Doubts());
  std::optional<OtherCalibration> rival;
  if (doubted || !own.ok() || explained < (doubts ? kExplainedInDoubt : kExplained)) {
    rival = SearchRival(query, options, all, estimate.camera_from_map, agree, explained < kExplained);
  }
  // Nothing but what the matches allow as well, at no more than its distance.
  double allowed = 0.0;
  if (rival && !doubted && IsSame(query.pinhole, rival->pinhole) && !ManyMore(rival->num_inliers, agree)) {
    allowed = std::abs(std::log(rival->pinhole.fx_px / query.pinhole.fx_px));
    rival.reset();
  }
  std::optional<Recalibrated> better;
  bool believed = doubted.has_value();
  if (rival && (!doubted || ManyMore(rival->num_inliers, agree))) {
    better = Recalibrate(query, options, rival->pinhole, StartOf(*rival, matches));
    believed = ManyMore(rival->num_inliers, agree);
  } else if (doubted) {
    Estimate start = estimate;
    start.camera_from_map = doubted->camera_from_map;
    better = Recalibrate(query, options, doubted->Corrected(query.pinhole), std::move(start));
  }
  const auto inliers = static_cast<int>(estimate.inliers.size());
  const int with_better = better ? static_cast<int>(better->estimate.inliers.size()) : 0;
  // Where no more of the first matches bear it out than chance may, the guided search has to.
  if (better && with_better >= inliers && (believed || ManyMore(with_better, inliers))) return better->calibration;
  if (doubted) return doubted;
  if (!own.ok()) return std::nullopt;
  optimization::FocalEstimate open = *own;
  if (explained < kExplained) open.log_sigma = std::max(open.log_sigma, kUnexplainedSigma);
  if (better && with_better >= inliers) allowed = std::abs(std::log(better->calibration.scale));
  open.log_sigma = std::max(open.log_sigma, allowed);
  return open;
}

// The covariance of the pose, covering where it would be with the calibration that the matches show.
void DoubtCalibration(const ImageQuery& query, const RelocalizerOptions& options, std::span<const GroupMatch> matches,
                      Estimate* estimate, FoundPlace* place) {
  const auto calibration = JudgeCalibration(query, options, matches, *estimate);
  if (!calibration) return;
  estimate->covariance = optimization::CoverFocal(estimate->camera_from_map, estimate->covariance, *calibration);
  if (calibration->Contradicts()) place->focal_factor = calibration->scale;
}

FoundPlace ToPlace(const ImageQuery& query, const RelocalizerOptions& options, std::span<const GroupMatch> matches,
                   bool accepted, Estimate estimate) {
  FoundPlace place;
  place.camera_from_map = estimate.camera_from_map;
  if (accepted) DoubtCalibration(query, options, matches, &estimate, &place);
  place.covariance = optimization::CovarianceOfInverse(estimate.camera_from_map, estimate.covariance);
  place.fit = estimate.fit;
  place.fit.inliers = static_cast<int>(estimate.inliers.size());
  place.reference_keyframe = ReferenceKeyframe(query.map, estimate.inliers);
  place.inliers = std::move(estimate.inliers);
  return place;
}

}  // namespace

absl::StatusOr<Relocalization> AttemptPose(const ImageQuery& query, KeyframeId founder,
                                           std::span<const GroupMatch> matches, std::uint64_t number,
                                           const RelocalizationCounts& counts, const RelocalizerOptions& options) {
  Relocalization attempt;
  attempt.counts = counts;
  attempt.counts.word_matches = static_cast<int>(matches.size());
  if (attempt.counts.word_matches < options.min_word_matches) {
    Miss(RelocalizationStage::kMatches,
         absl::StrCat(matches.size(), " matches with keyframe ", founder.value(), " and those around it, at least ",
                      options.min_word_matches, " needed"),
         &attempt);
    return attempt;
  }

  const std::vector<PoseObservation> observations = ObservationsOf(query, matches);
  PnpOptions pnp = options.pnp;
  pnp.seed += number * 0x9E3779B97F4A7C15ull;
  CAIRN_ASSIGN_OR_RETURN(const PnpSolution solution, SolvePnpRansac(query.pinhole, observations, pnp));
  attempt.counts.pnp_inliers = solution.num_inliers;
  if (!solution.found) {
    Miss(RelocalizationStage::kPnp,
         absl::StrCat(solution.num_inliers, " of ", matches.size(), " matches agree on a pose, at least ",
                      pnp.min_inliers, " needed"),
         &attempt);
    return attempt;
  }

  Estimate estimate;
  estimate.camera_from_map = solution.camera_from_map;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (solution.inlier[i]) estimate.inliers.push_back({matches[i].point, matches[i].feature});
  }
  if (!Guide(query, options, &estimate, &attempt.counts)) {
    Miss(RelocalizationStage::kRefinement, "the refinement on the matches of the guided search failed", &attempt);
    return attempt;
  }
  std::string objection = Objection(estimate, attempt.counts, estimate.covariance, options);
  attempt.place = ToPlace(query, options, matches, objection.empty(), std::move(estimate));
  if (!objection.empty()) {
    Miss(RelocalizationStage::kRefinement, std::move(objection), &attempt);
    return attempt;
  }
  attempt.localized = true;
  attempt.beyond_doubt = IsStrong(attempt.counts, options);
  attempt.stage = RelocalizationStage::kDone;
  return attempt;
}

std::optional<CalibrationFit> FitWithAnotherCalibration(const ImageQuery& query, std::span<const GroupMatch> matches,
                                                        int as_calibrated, const RelocalizerOptions& options) {
  const auto other = SearchCalibration(query.pinhole, ObservationsOf(query, matches), options.pnp);
  if (!other || other->num_inliers < options.min_word_matches || !ManyMore(other->num_inliers, as_calibrated)) {
    return std::nullopt;
  }
  const auto found = Recalibrate(query, options, other->pinhole, StartOf(*other, matches));
  if (!found || !found->calibration.Contradicts()) return std::nullopt;
  if (!Objection(found->estimate, found->counts, found->estimate.covariance, options).empty()) return std::nullopt;
  return CalibrationFit{found->calibration.scale, found->counts.inliers,
                        ReferenceKeyframe(query.map, found->estimate.inliers)};
}

}  // namespace cairn::tracking

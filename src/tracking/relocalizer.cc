#include "tracking/relocalizer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <unordered_map>
#include <unordered_set>

#include "optimization/pose_refinement.h"

namespace cairn::tracking {
namespace {

using optimization::PoseObservation;

constexpr int kCells = 8;             // the image in 8 x 8 cells, to see how the inliers are spread
constexpr double kViewMargin = 0.15;  // around the image, share of its width

struct Group {
  double score = 0.0;
  std::vector<KeyframeId> keyframes;  // the candidate first
};

// One image to be located; everything that all attempts share.
struct Query {
  const map::Snapshot& map;
  const PlaceIndex& places;
  const Pinhole& pinhole;
  const image::Features& features;
  image::FeatureGrid grid;
  PlaceIndex::Words words;

  double SigmaPx(std::uint32_t feature) const { return map.info().orb.Scale(features.keypoints[feature].octave); }
  PoseObservation Observation(const Vector3d& point, std::uint32_t feature) const {
    const image::Keypoint& keypoint = features.keypoints[feature];
    return {point, {keypoint.x_px, keypoint.y_px}, SigmaPx(feature)};
  }
  std::size_t Cell(const Vector2d& pixel) const {
    const auto part = [](double x, int size) {
      return static_cast<std::size_t>(std::clamp(static_cast<int>(x * kCells / size), 0, kCells - 1));
    };
    return part(pixel.y(), pinhole.height_px) * kCells + part(pixel.x(), pinhole.width_px);
  }
};

// Each candidate with its covisible keyframes; the group's score is the sum of its members' (eq. in Sec. III-B of the
// 2014 paper). A candidate that is a member of a better group does not found one.
std::vector<Group> FormGroups(const map::Snapshot& map, const std::vector<place::Candidate>& candidates,
                              const RelocalizerOptions& options) {
  std::unordered_map<KeyframeId, double> score_of;
  for (const place::Candidate& candidate : candidates) score_of[KeyframeId(candidate.id)] = candidate.score;
  std::vector<Group> groups;
  for (const place::Candidate& candidate : candidates) {
    const map::Keyframe* keyframe = map.keyframes().Find(KeyframeId(candidate.id));
    if (keyframe == nullptr) continue;
    Group group;
    group.keyframes.push_back(keyframe->id);
    group.score = candidate.score;
    if (options.group_size > 1) {
      for (const KeyframeId id : map::BestCovisible(*keyframe, options.group_size - 1)) {
        group.keyframes.push_back(id);
        if (const auto found = score_of.find(id); found != score_of.end()) group.score += found->second;
      }
    }
    groups.push_back(std::move(group));
  }
  std::stable_sort(groups.begin(), groups.end(), [](const Group& a, const Group& b) {
    return a.score != b.score ? a.score > b.score : a.keyframes[0] < b.keyframes[0];
  });
  std::vector<Group> chosen;
  std::unordered_set<KeyframeId> covered;
  for (Group& group : groups) {
    if (static_cast<int>(chosen.size()) >= options.max_groups) break;
    if (!chosen.empty() && group.score < options.min_group_score * chosen[0].score) break;
    if (covered.contains(group.keyframes[0])) continue;
    covered.insert(group.keyframes.begin(), group.keyframes.end());
    chosen.push_back(std::move(group));
  }
  return chosen;
}

void Miss(RelocalizationStage stage, std::string reason, Relocalization* attempt) {
  attempt->stage = stage;
  attempt->reason = std::move(reason);
}

// The pose while guided search works on it, and what supports it.
struct Estimate {
  SE3 camera_from_map;
  Matrix6d covariance = Matrix6d::Zero();  // of camera_from_map
  std::vector<PointObservation> inliers;
  double median_depth = 0.0;
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

// The points of the local map that may be in view, with a margin for what the pose may still change.
struct GuidedPoints {
  std::vector<const map::MapPoint*> points;
  DescriptorLists descriptors;
};

GuidedPoints PointsAround(const Query& query, const RelocalizerOptions& options, const Estimate& estimate) {
  const LocalMap local = LocalMapOfPoints(query.map, PointsOf(estimate.inliers), options.local_map);
  GuidedPoints around;
  for (const map::MapPoint* point : local.points) {
    const Vector3d point_c = estimate.camera_from_map * point->position;
    if (!(point_c.z() > 1e-9)) continue;
    if (!query.pinhole.Contains(query.pinhole.Project(point_c), -kViewMargin * query.pinhole.width_px)) continue;
    around.points.push_back(point);
  }
  around.descriptors = ObservedDescriptors(query.map, around.points, options.descriptors_per_point);
  return around;
}

// One round of guided search and refinement. False if the refinement fails.
bool GuidedRound(const Query& query, const RelocalizerOptions& options, double radius_factor,
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
  estimate->inliers.clear();
  std::vector<double> depths;
  std::array<bool, kCells * kCells> cell{}, visible_cell{};
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (!refined->inlier[i]) continue;
    estimate->inliers.push_back({around.points[found.matches[i].point]->id, found.matches[i].feature});
    depths.push_back((refined->camera_from_map * observations[i].point).z());
    cell[query.Cell(observations[i].pixel)] = true;
  }
  std::nth_element(depths.begin(), depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2), depths.end());
  estimate->median_depth = depths[depths.size() / 2];
  for (const std::uint32_t i : found.visible) {
    const Vector3d point_c = estimate->camera_from_map * around.points[i]->position;
    if (optimization::InFront(point_c)) visible_cell[query.Cell(query.pinhole.Project(point_c))] = true;
  }
  counts->cells = static_cast<int>(std::count(cell.begin(), cell.end(), true));
  counts->visible_cells = static_cast<int>(std::count(visible_cell.begin(), visible_cell.end(), true));
  counts->inliers = static_cast<int>(estimate->inliers.size());
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
  const int needed =
      std::max(options.min_cells, static_cast<int>(std::ceil(options.min_support * counts.visible_cells)));
  if (counts.cells < needed) {
    return absl::StrCat(counts.inliers, " inliers lie in ", counts.cells, " of the ", counts.visible_cells,
                        " cells of the image that should show points of the map, at least ", needed, " needed");
  }
  const double position_sigma = std::sqrt(covariance.topLeftCorner<3, 3>().trace()) / estimate.median_depth;
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
  return counts.inliers >= options.strong_inliers && counts.cells >= options.strong_support * counts.visible_cells;
}

KeyframeId ReferenceKeyframe(const map::Snapshot& map, const std::vector<PointObservation>& inliers) {
  return LocalMapOfPoints(map, PointsOf(inliers),
                          {.max_keyframes = 1, .neighbours_per_keyframe = 0, .tree_neighbours = false})
      .reference();
}

absl::StatusOr<Relocalization> TryGroup(const Query& query, const Group& group, std::uint64_t number,
                                        const RelocalizerOptions& options, const RelocalizationCounts& counts) {
  Relocalization attempt;
  attempt.counts = counts;
  const auto matches =
      MatchGroup(query.map, query.places, group.keyframes, query.features, query.words.nodes, options.matching);
  attempt.counts.word_matches = static_cast<int>(matches.size());
  if (attempt.counts.word_matches < options.min_word_matches) {
    Miss(RelocalizationStage::kMatches,
         absl::StrCat(matches.size(), " matches with keyframe ", group.keyframes[0].value(),
                      " and those around it, at least ", options.min_word_matches, " needed"),
         &attempt);
    return attempt;
  }

  std::vector<PoseObservation> observations;
  for (const GroupMatch& match : matches) {
    observations.push_back(query.Observation(query.map.point(match.point).position, match.feature));
  }
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
  GuidedPoints around;
  for (std::size_t round = 0; round < options.guided_radius_factors.size(); ++round) {
    // The first round shows better than PnP what is in view; after the second that changes no more.
    if (round < 2) around = PointsAround(query, options, estimate);
    if (!GuidedRound(query, options, options.guided_radius_factors[round], around, &estimate, &attempt.counts)) {
      Miss(RelocalizationStage::kRefinement, "the refinement on the matches of the guided search failed", &attempt);
      return attempt;
    }
  }
  const Matrix6d covariance = optimization::CovarianceOfInverse(estimate.camera_from_map, estimate.covariance);
  std::string objection = Objection(estimate, attempt.counts, estimate.covariance, options);
  attempt.camera_from_map = estimate.camera_from_map;
  attempt.covariance = covariance;
  attempt.inliers = std::move(estimate.inliers);
  attempt.reference_keyframe = ReferenceKeyframe(query.map, attempt.inliers);
  if (!objection.empty()) {
    Miss(RelocalizationStage::kRefinement, std::move(objection), &attempt);
    return attempt;
  }
  attempt.localized = true;
  attempt.beyond_doubt = IsStrong(attempt.counts, options);
  attempt.stage = RelocalizationStage::kDone;
  return attempt;
}

// Which of two attempts is better, or got further.
bool Better(const Relocalization& a, const Relocalization& b) {
  if (a.stage != b.stage) return a.stage > b.stage;
  if (a.counts.inliers != b.counts.inliers) return a.counts.inliers > b.counts.inliers;
  if (a.counts.pnp_inliers != b.counts.pnp_inliers) return a.counts.pnp_inliers > b.counts.pnp_inliers;
  return a.counts.word_matches > b.counts.word_matches;
}

}  // namespace

absl::Status RelocalizerOptions::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("relocalizer: ", what)); };
  if (min_features < 4) return bad("min_features must be at least 4");
  if (max_candidate_keyframes < 1) return bad("max_candidate_keyframes must be at least 1");
  if (max_groups < 1) return bad("max_groups must be at least 1");
  if (group_size < 1) return bad("group_size must be at least 1");
  if (!(min_group_score >= 0.0 && min_group_score <= 1.0)) return bad("min_group_score must be in [0, 1]");
  if (min_word_matches < 4) return bad("min_word_matches must be at least 4");
  if (guided_radius_factors.empty()) return bad("guided_radius_factors must have at least one entry");
  for (const double factor : guided_radius_factors) {
    if (!(factor > 0.0)) return bad("guided_radius_factors must be positive");
  }
  if (descriptors_per_point < 1) return bad("descriptors_per_point must be at least 1");
  if (min_inliers < 6) return bad("min_inliers must be at least 6");
  if (min_cells < 1 || min_cells > kCells * kCells) return bad("min_cells must be from 1 to 64");
  if (!(min_support >= 0.0 && min_support <= 1.0)) return bad("min_support must be in [0, 1]");
  if (strong_inliers < min_inliers) return bad("strong_inliers must not be below min_inliers");
  if (!(strong_support >= min_support && strong_support <= 1.0)) {
    return bad("strong_support must be in [min_support, 1]");
  }
  if (!(max_position_sigma > 0.0)) return bad("max_position_sigma must be positive");
  if (!(max_rotation_sigma_deg > 0.0)) return bad("max_rotation_sigma_deg must be positive");
  ProjectionOptions projection;
  projection.max_distance = guided_max_distance;
  projection.max_ratio = guided_max_ratio;
  projection.max_viewing_angle_deg = guided_max_viewing_angle_deg;
  projection.distance_slack = guided_distance_slack;
  CAIRN_RETURN_IF_ERROR(Annotate(projection.Validate(), "relocalizer: guided search"));
  CAIRN_RETURN_IF_ERROR(matching.Validate());
  CAIRN_RETURN_IF_ERROR(local_map.Validate());
  return pnp.Validate();
}

absl::StatusOr<Relocalization> Relocalizer::Relocalize(const map::Snapshot& map, const PlaceIndex& places,
                                                       const Pinhole& pinhole, const image::Features& features,
                                                       const SearchArea& area) const {
  CAIRN_RETURN_IF_ERROR(options_.Validate());
  if (pinhole.width_px <= 0 || pinhole.height_px <= 0 || !(pinhole.fx_px > 0.0) || !(pinhole.fy_px > 0.0)) {
    return absl::InvalidArgumentError("relocalizer: the camera has no positive size and focal length");
  }
  if (places.revision() != map.revision()) {
    return absl::FailedPreconditionError(absl::StrCat("relocalizer: the places are of revision ", places.revision(),
                                                      ", the map of revision ", map.revision()));
  }
  Relocalization best;
  best.counts.features = static_cast<int>(features.size());
  if (best.counts.features < options_.min_features) {
    Miss(RelocalizationStage::kFeatures,
         absl::StrCat(features.size(), " features in the image, at least ", options_.min_features, " needed"), &best);
    return best;
  }
  const Query query{map,
                    places,
                    pinhole,
                    features,
                    image::FeatureGrid(features.keypoints, pinhole.width_px, pinhole.height_px),
                    places.Transform(features.descriptors)};
  place::QueryOptions candidates_wanted;
  candidates_wanted.min_common_share = 0.0;
  candidates_wanted.max_results = static_cast<std::size_t>(options_.max_candidate_keyframes);
  if (area.only || area.except) {
    candidates_wanted.exclude = [&](std::uint32_t id) {
      return !area.Contains(map.keyframe(KeyframeId(id)).component);
    };
  }
  const auto candidates = places.Query(query.words.bow, candidates_wanted);
  best.counts.candidates = static_cast<int>(candidates.size());
  const std::vector<Group> groups = FormGroups(map, candidates, options_);
  if (groups.empty()) {
    Miss(RelocalizationStage::kCandidates, "no keyframe of the map shares a word with the image", &best);
    return best;
  }
  const RelocalizationCounts counts = best.counts;
  best.stage = RelocalizationStage::kCandidates;
  for (std::size_t i = 0; i < groups.size(); ++i) {
    CAIRN_ASSIGN_OR_RETURN(Relocalization attempt, TryGroup(query, groups[i], i, options_, counts));
    if (attempt.beyond_doubt) return attempt;
    if (i == 0 || Better(attempt, best)) best = std::move(attempt);
  }
  return best;
}

}  // namespace cairn::tracking

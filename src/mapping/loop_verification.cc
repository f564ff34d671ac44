#include "mapping/loop_verification.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "base/angles.h"
#include "base/median.h"
#include "mapping/grid_cache.h"
#include "mapping/view_share.h"
#include "optimization/sim3_refinement.h"
#include "tracking/local_map.h"
#include "tracking/projection_matcher.h"

namespace cairn::mapping {
namespace {

using optimization::Sim3Match;

constexpr int kSpreadCells = 8;
constexpr double kSampleTolerance = 9.0;  // of chi-square: three times the distance

// The features of a keyframe that observe a point.
struct WithPoints {
  explicit WithPoints(const map::Keyframe& keyframe) {
    for (std::uint32_t i = 0; i < keyframe.points.size(); ++i) {
      if (!keyframe.points[i]) continue;
      features.keypoints.push_back(keyframe.keypoints()[i]);
      features.descriptors.push_back(keyframe.descriptors()[i]);
      index.push_back(i);
    }
  }
  image::Features features;
  std::vector<std::uint32_t> index;  // in the keyframe
};

std::optional<std::uint32_t> FeatureOf(const map::MapPoint& point, KeyframeId keyframe) {
  const auto at = std::lower_bound(point.observations.begin(), point.observations.end(), map::Observation{keyframe, 0});
  if (at == point.observations.end() || at->keyframe != keyframe) return std::nullopt;
  return at->feature;
}

class Verifier {
 public:
  Verifier(const map::Snapshot& map, KeyframeId current, KeyframeId candidate, const LoopOptions& options,
           LoopEvidence* evidence)
      : map_(map),
        current_(map.keyframe(current)),
        loop_(map.keyframe(candidate)),
        options_(options),
        evidence_(*evidence) {}

  // `given`: matches with points on the loop's side; null: to be found by descriptors.
  std::optional<Loop> Run(const std::vector<LoopMatch>* given) {
    evidence_ = LoopEvidence();
    evidence_.candidate = loop_.id;
    Loop loop;
    loop.current = current_.id;
    loop.loop = loop_.id;
    loop.loop_side = Side(loop_, {});
    current_side_ = Side(current_, loop.loop_side);
    const std::vector<Sim3Match> matches = given == nullptr ? MatchDescriptors() : Matches(*given);
    if (!FindSimilarity(matches, &loop) || !MatchGuided(&loop)) return std::nullopt;
    if (given == nullptr ? !Plausible(loop) : !EnoughWithoutALink(loop)) return std::nullopt;
    const bool here = NeighboursAgree(current_, current_side_, loop_, loop.loop_side, loop.current_from_loop);
    if (!here || !NeighboursAgree(loop_, loop.loop_side, current_, current_side_, loop.current_from_loop.Inverse())) {
      return std::nullopt;
    }
    return loop;
  }

 private:
  bool Reject(std::string why) {
    evidence_.rejected = std::move(why);
    return false;
  }

  // A keyframe and those covisible with it, without those of the other side.
  std::vector<KeyframeId> Side(const map::Keyframe& keyframe, std::span<const KeyframeId> without) const {
    std::vector<KeyframeId> side = {keyframe.id};
    for (const KeyframeId id : map::BestCovisible(keyframe, options_.neighbourhood)) {
      if (std::ranges::find(without, id) == without.end()) side.push_back(id);
    }
    return side;
  }

  std::vector<const map::MapPoint*> PointsOf(std::span<const KeyframeId> side) const {
    tracking::LocalMapOptions only_these;
    only_these.max_keyframes = static_cast<int>(side.size());
    only_these.neighbours_per_keyframe = 0;
    only_these.tree_neighbours = false;
    return tracking::LocalMapOfKeyframes(map_, side, only_these).points;
  }

  double SigmaPx(const map::Keyframe& keyframe, std::uint32_t feature) const {
    return map_.info().orb.Scale(keyframe.keypoints()[feature].octave);
  }
  static Vector2d Pixel(const map::Keyframe& keyframe, std::uint32_t feature) {
    return {keyframe.keypoints()[feature].x_px, keyframe.keypoints()[feature].y_px};
  }

  // Feature of keyframe a against a point of the map on the side of keyframe b.
  Sim3Match MakeMatch(const map::Keyframe& a, std::uint32_t feature, const map::Keyframe& b,
                      const map::MapPoint& point) const {
    Sim3Match match;
    match.pixel_a = Pixel(a, feature);
    match.sigma_a_px = SigmaPx(a, feature);
    match.point_b = b.camera_from_map * point.position;
    const map::MapPoint* own = a.points[feature] ? map_.points().Find(a.points[feature]) : nullptr;
    match.has_point_a = own != nullptr && own != &point;
    if (match.has_point_a) match.point_a = a.camera_from_map * own->position;
    const auto in_b = FeatureOf(point, b.id);
    match.has_pixel_b = in_b.has_value();
    if (in_b) {
      match.pixel_b = Pixel(b, *in_b);
      match.sigma_b_px = SigmaPx(b, *in_b);
    }
    return match;
  }

  std::vector<Sim3Match> Matches(const std::vector<LoopMatch>& given) const {
    std::vector<Sim3Match> matches;
    for (const LoopMatch& match : given) {
      // Only both positions of a point tell the scale.
      if (!current_.points[match.feature] || !map_.points().Contains(match.point)) continue;
      matches.push_back(MakeMatch(current_, match.feature, loop_, map_.point(match.point)));
    }
    return matches;
  }

  std::vector<Sim3Match> MatchDescriptors() const {
    image::MatchOptions matching;
    matching.max_distance = options_.match_max_distance;
    matching.max_ratio = options_.match_max_ratio;
    // Every feature that has a point against every one: candidates are few, and a search by words misses many.
    const WithPoints here(current_), there(loop_);
    std::vector<image::FeatureMatch> pairs = image::MatchBruteForce(here.features, there.features, matching);
    for (image::FeatureMatch& pair : pairs) {
      pair.a = here.index[pair.a];
      pair.b = there.index[pair.b];
    }
    std::vector<Sim3Match> matches;
    for (const image::FeatureMatch& pair : pairs) {
      if (current_.points[pair.a] == loop_.points[pair.b]) continue;
      matches.push_back(MakeMatch(current_, pair.a, loop_, map_.point(loop_.points[pair.b])));
    }
    return matches;
  }

  bool FindSimilarity(const std::vector<Sim3Match>& matches, Loop* loop) {
    evidence_.descriptor_matches = static_cast<int>(matches.size());
    if (evidence_.descriptor_matches < options_.min_sim3_inliers)
      return Reject("few matches with points on both sides");
    optimization::Sim3RansacOptions ransac;
    ransac.min_inliers = options_.min_sim3_inliers;
    // Three points with errors of depth fit the others badly: what they are worth shows after refinement.
    ransac.chi2_threshold = kSampleTolerance * optimization::kChiSquarePixel99;
    ransac.seed = (std::uint64_t{current_.id.value()} << 32) + loop_.id.value();
    const auto found = FindSim3(PinholeOf(current_), PinholeOf(loop_), matches, ransac);
    if (!found.ok()) return Reject("the first matches agree on no similarity");
    optimization::Sim3RefinementOptions refinement;
    refinement.min_inliers = options_.min_sim3_inliers;
    const auto refined = RefineSim3(PinholeOf(current_), PinholeOf(loop_), found->a_from_b, matches, refinement);
    if (!refined.ok()) return Reject("the similarity of the first matches does not hold");
    evidence_.sim3_inliers = refined->num_inliers;
    loop->current_from_loop = refined->a_from_b;
    return true;
  }

  const Pinhole& PinholeOf(const map::Keyframe& keyframe) const { return map_.pinhole(keyframe.camera); }

  // Points of the side of keyframe b, in keyframe a.
  tracking::ProjectionMatches Project(const map::Keyframe& a, const map::Keyframe& b, const Sim3& a_from_b,
                                      std::span<const map::MapPoint* const> points, double radius_factor) {
    const Pinhole& pinhole = PinholeOf(a);
    const tracking::FeatureView view{pinhole, a.features->features, grids_.Of(a, pinhole)};
    tracking::ProjectionOptions projection;
    projection.radius_factor = radius_factor;
    projection.max_distance = options_.guided_max_distance;
    return tracking::MatchByProjection(view, RigidPart(a_from_b * Sim3(b.camera_from_map)), points, map_.info().orb,
                                       projection);
  }

  bool MatchGuided(Loop* loop) {
    const std::vector<const map::MapPoint*> points = PointsOf(loop->loop_side);
    optimization::Sim3RefinementOptions refinement;
    refinement.min_inliers = options_.min_sim3_inliers;
    for (const double factor : options_.guided_radius_factors) {
      const auto found = Project(current_, loop_, loop->current_from_loop, points, factor).matches;
      std::vector<Sim3Match> matches;
      int complete = 0;
      for (const tracking::PointMatch& match : found) {
        matches.push_back(MakeMatch(current_, match.feature, loop_, *points[match.point]));
        complete += matches.back().has_point_a ? 1 : 0;
      }
      evidence_.guided_matches = static_cast<int>(found.size());
      if (complete < options_.min_sim3_inliers) return Reject("few matches by projection have points on both sides");
      const auto refined =
          RefineSim3(PinholeOf(current_), PinholeOf(loop_), loop->current_from_loop, matches, refinement);
      if (!refined.ok()) return Reject("the matches by projection agree on no similarity");
      loop->current_from_loop = refined->a_from_b;
      loop->matches.clear();
      for (std::size_t i = 0; i < found.size(); ++i) {
        if (refined->inlier[i]) loop->matches.push_back({found[i].feature, points[found[i].point]->id});
      }
      evidence_.guided_matches = refined->num_inliers;
    }
    evidence_.scale = loop->current_from_loop.scale();
    evidence_.cells = CellsOf(loop->matches);
    if (evidence_.guided_matches < options_.min_guided_matches) return Reject("few matches by projection");
    if (evidence_.cells < options_.min_cells) return Reject("the matches are in one part of the image only");
    return true;
  }

  int CellsOf(std::span<const LoopMatch> matches) const {
    const Pinhole& pinhole = PinholeOf(current_);
    std::unordered_set<int> cells;
    for (const LoopMatch& match : matches) {
      const Vector2d pixel = Pixel(current_, match.feature);
      const int x = std::clamp(static_cast<int>(pixel.x() * kSpreadCells / pinhole.width_px), 0, kSpreadCells - 1);
      const int y = std::clamp(static_cast<int>(pixel.y() * kSpreadCells / pinhole.height_px), 0, kSpreadCells - 1);
      cells.insert(y * kSpreadCells + x);
    }
    return static_cast<int>(cells.size());
  }

  static double MedianDepth(std::vector<double> depths) { return depths.empty() ? 1.0 : Median(std::move(depths)); }

  // Of the other side, what the keyframes of `side`, attached rigidly to `anchor`, should see and do. Those that see
  // none of it are left out: from where they are, walls may hide it.
  ViewShare ShareOf(const map::Keyframe& anchor, std::span<const KeyframeId> side, const map::Keyframe& other,
                    std::span<const KeyframeId> other_side, const Sim3& anchor_from_other) {
    const std::vector<const map::MapPoint*> points = PointsOf(other_side);
    ViewShare share;
    for (const KeyframeId id : side) {
      const map::Keyframe& viewer = map_.keyframe(id);
      const Sim3 from_other = Sim3(viewer.camera_from_map * anchor.camera_from_map.Inverse()) * anchor_from_other;
      const auto found = Project(viewer, other, from_other, points, options_.guided_radius_factors.back());
      if (!SeesEnough(found)) continue;
      share += ShareSeen(map_, viewer, from_other * Sim3(other.camera_from_map), points, found,
                         grids_.Of(viewer, PinholeOf(viewer)));
    }
    return share;
  }

  bool SeesEnough(const tracking::ProjectionMatches& found) const {
    return static_cast<double>(found.matches.size()) >=
           std::max<double>(options_.min_neighbour_matches,
                            options_.min_neighbour_share * static_cast<double>(found.visible.size()));
  }

  bool EnoughWithoutALink(const Loop& loop) {
    if (evidence_.guided_matches < options_.min_unlinked_matches) {
      return Reject("few matches by projection for places that nothing links");
    }
    if (evidence_.cells < options_.min_unlinked_cells) {
      return Reject("the matches are in too small a part of the image for places that nothing links");
    }
    const Sim3& current_from_loop = loop.current_from_loop;
    const ViewShare here = ShareOf(current_, current_side_, loop_, loop.loop_side, current_from_loop);
    const ViewShare there = ShareOf(loop_, loop.loop_side, current_, current_side_, current_from_loop.Inverse());
    evidence_.share_here = here.value();
    evidence_.share_there = there.value();
    if (std::min(here.expected, there.expected) < options_.min_unlinked_cells) {
      return Reject("too little of the view can be compared for places that nothing links");
    }
    if (std::min(here.value(), there.value()) < options_.min_unlinked_share) {
      return Reject("much of what should be seen there is not: it looks alike, but is another place");
    }
    return true;
  }

  bool Plausible(const Loop& loop) {
    const Sim3 moved_from_map = loop.current_from_loop * Sim3(loop_.camera_from_map);
    const Vector3d moved = moved_from_map.Inverse().translation();
    evidence_.shift = (moved - current_.CenterInMap()).norm();
    evidence_.turn_rad = AngleRad(moved_from_map.rotation() * current_.camera_from_map.rotation().conjugate());
    const std::optional<double> length = PathLength(map_, current_.id, loop_.id);
    linked_ = length.has_value();
    if (!linked_) return EnoughWithoutALink(loop);
    evidence_.path_length = *length;
    std::vector<double> depths;
    for (const PointId id : current_.points) {
      if (id) depths.push_back((current_.camera_from_map * map_.point(id).position).z());
    }
    const double limit = options_.max_drift_share * *length + options_.drift_slack * MedianDepth(std::move(depths));
    const double scale = std::max(evidence_.scale, 1.0 / evidence_.scale);
    if (evidence_.shift > limit || kDegPerRad * evidence_.turn_rad > options_.max_turn_deg ||
        scale > options_.max_scale_change) {
      return Reject("odometry does not drift that much: it looks alike, but is another place");
    }
    return true;
  }

  // Whether a neighbour of keyframe `anchor`, attached to it rigidly, sees points of the other side where the
  // similarity puts them, and comes to the same similarity by itself. Nothing if it should not see enough of them.
  std::optional<bool> Agrees(const map::Keyframe& neighbour, const map::Keyframe& anchor, const map::Keyframe& other,
                             const Sim3& anchor_from_other, std::span<const map::MapPoint* const> points) {
    const Sim3 predicted =
        Sim3(neighbour.camera_from_map * anchor.camera_from_map.Inverse()) * anchor_from_other;  // from `other`
    const auto found = Project(neighbour, other, predicted, points, options_.guided_radius_factors.back());
    if (static_cast<int>(found.visible.size()) < options_.min_neighbour_visible) return std::nullopt;
    if (!SeesEnough(found)) {
      // What is hidden, or not there, is judged by the share of all (ShareOf) where it is.
      return linked_ ? std::optional(false) : std::nullopt;
    }
    std::vector<Sim3Match> matches;
    std::vector<double> depths;
    for (const tracking::PointMatch& match : found.matches) {
      matches.push_back(MakeMatch(neighbour, match.feature, other, *points[match.point]));
      depths.push_back((predicted * matches.back().point_b).z());
    }
    optimization::Sim3RefinementOptions refinement;
    refinement.min_inliers = options_.min_neighbour_matches;
    const auto own = RefineSim3(PinholeOf(neighbour), PinholeOf(other), predicted, matches, refinement);
    if (!own.ok()) return false;
    const Sim3 difference = own->a_from_b * predicted.Inverse();
    const double turn_deg = kDegPerRad * AngleRad(difference.rotation());
    const double scale = std::max(difference.scale(), 1.0 / difference.scale());
    // Of the camera, in its own unit: where the predicted camera's centre is seen from the one found.
    const double shift = difference.Inverse().translation().norm() / MedianDepth(std::move(depths));
    return turn_deg <= options_.max_neighbour_turn_deg && scale <= options_.max_neighbour_scale &&
           shift <= options_.max_neighbour_shift;
  }

  bool NeighboursAgree(const map::Keyframe& anchor, std::span<const KeyframeId> side, const map::Keyframe& other,
                       std::span<const KeyframeId> other_side, const Sim3& anchor_from_other) {
    const std::vector<const map::MapPoint*> points = PointsOf(other_side);
    int checked = 0, agreeing = 0;
    for (std::size_t i = 1; i < side.size() && checked < options_.neighbours_checked; ++i) {
      const auto agrees = Agrees(map_.keyframe(side[i]), anchor, other, anchor_from_other, points);
      checked += agrees ? 1 : 0;
      agreeing += agrees && *agrees ? 1 : 0;
    }
    evidence_.neighbours_checked += checked;
    evidence_.neighbours_agreeing += agreeing;
    // Where nothing links the sides, the share of the view was asked of all neighbours already.
    const int needed = linked_ ? options_.min_neighbours_agreeing : 1;
    if (agreeing >= needed && agreeing >= options_.min_agreeing_share * checked) return true;
    return Reject("the neighbours do not agree");
  }

  const map::Snapshot& map_;
  const map::Keyframe& current_;
  const map::Keyframe& loop_;
  const LoopOptions& options_;
  LoopEvidence& evidence_;
  std::vector<KeyframeId> current_side_;
  bool linked_ = false;  // by a way along the spanning tree
  GridCache grids_;
};

}  // namespace

std::optional<double> PathLength(const map::Snapshot& map, KeyframeId a, KeyframeId b) {
  // From a up to the root, with the length so far; then from b until the first of these.
  constexpr double kUnknown = 1e300;
  const auto step = [&](const map::Keyframe& child) {
    const auto linked = std::ranges::find(child.covisible, child.parent, &map::CovisibilityEdge::keyframe);
    if (linked == child.covisible.end()) return kUnknown;
    return (child.CenterInMap() - map.keyframe(child.parent).CenterInMap()).norm();
  };
  std::unordered_map<KeyframeId, double> from_a;
  double length = 0.0;
  for (KeyframeId at = a; at; at = map.keyframe(at).parent) {
    if (!from_a.emplace(at, length).second) break;
    if (map.keyframe(at).parent) length += step(map.keyframe(at));
  }
  length = 0.0;
  for (KeyframeId at = b; at; at = map.keyframe(at).parent) {
    if (const auto met = from_a.find(at); met != from_a.end()) {
      const double sum = length + met->second;
      return sum < kUnknown ? std::optional(sum) : std::nullopt;
    }
    if (map.keyframe(at).parent) length += step(map.keyframe(at));
  }
  return std::nullopt;
}

std::optional<Loop> VerifyLoop(const map::Snapshot& map, KeyframeId current, KeyframeId candidate,
                               const LoopOptions& options, LoopEvidence* evidence) {
  return Verifier(map, current, candidate, options, evidence).Run(nullptr);
}

std::optional<Loop> VerifyOverlap(const map::Snapshot& map, KeyframeId current, KeyframeId candidate,
                                  const std::vector<LoopMatch>& matches, const LoopOptions& options,
                                  LoopEvidence* evidence) {
  return Verifier(map, current, candidate, options, evidence).Run(&matches);
}

}  // namespace cairn::mapping

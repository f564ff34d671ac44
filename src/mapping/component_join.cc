#include "mapping/component_join.h"

#include <algorithm>
#include <optional>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "base/angles.h"
#include "base/median.h"
#include "mapping/local_adjustment.h"
#include "mapping/loop_correction.h"
#include "mapping/stopwatch.h"
#include "optimization/lens_adjustment.h"

namespace cairn::mapping {
namespace {

// The similarity from the component of the current keyframe to that of the other one.
Sim3 OtherFromOwn(const map::Snapshot& map, const Loop& overlap) {
  const Sim3 other_camera_from_other(map.keyframe(overlap.loop).camera_from_map);
  const Sim3 camera_from_own(map.keyframe(overlap.current).camera_from_map);
  return other_camera_from_other.Inverse() * overlap.current_from_loop.Inverse() * camera_from_own;
}

// A keyframe and those around it, breadth first along covisibility, within its component.
std::vector<KeyframeId> Around(const map::Edit& edit, KeyframeId from, std::size_t max_count,
                               const std::unordered_set<KeyframeId>& among) {
  std::vector<KeyframeId> around = {from};
  std::unordered_set<KeyframeId> known = {from};
  for (std::size_t i = 0; i < around.size() && around.size() < max_count; ++i) {
    for (const KeyframeId id : map::BestCovisible(edit.keyframe(around[i]))) {
      if (around.size() < max_count && among.contains(id) && known.insert(id).second) around.push_back(id);
    }
  }
  std::sort(around.begin(), around.end());
  return around;
}

void Touch(SessionId session_id, ComponentId component, map::Edit* edit) {
  map::Session session = edit->session(session_id);
  auto& touched = session.components;
  const auto at = std::lower_bound(touched.begin(), touched.end(), component);
  if (at != touched.end() && *at == component) return;
  touched.insert(at, component);
  edit->PutSession(session);
}

// The images of one camera against points that others have mapped: the poses are free, and the keyframes that made the
// points hold them.
class CameraProblem {
 public:
  CameraProblem(const map::Snapshot& map, const Pinhole& pinhole) : map_(map) { problem_.cameras = {pinhole}; }

  void Add(const map::Keyframe& keyframe, const SE3& camera_from_other, const std::vector<LoopMatch>& matches) {
    const auto pose = static_cast<std::uint32_t>(problem_.poses.size());
    problem_.poses.push_back({camera_from_other, 0, false});
    for (const LoopMatch& match : matches) {
      if (const map::MapPoint* point = map_.points().Find(match.point)) Observe(keyframe, match.feature, pose, *point);
    }
  }

  const optimization::BundleProblem& problem() const { return problem_; }

 private:
  void Observe(const map::Keyframe& keyframe, std::uint32_t feature, std::uint32_t pose, const map::MapPoint& point) {
    const auto [at, added] = point_of_.try_emplace(point.id, static_cast<std::uint32_t>(problem_.points.size()));
    const image::Keypoint& keypoint = keyframe.keypoints()[feature];
    problem_.observations.push_back(
        {pose, at->second, {keypoint.x_px, keypoint.y_px}, map_.info().orb.Scale(keypoint.octave)});
    if (!added) return;
    problem_.points.push_back(point.position);
    for (const map::Observation& observation : point.observations) {
      const map::Keyframe& other = map_.keyframe(observation.keyframe);
      const image::Keypoint& seen = other.keypoints()[observation.feature];
      problem_.observations.push_back(
          {PoseOf(other), at->second, {seen.x_px, seen.y_px}, map_.info().orb.Scale(seen.octave)});
    }
  }

  std::uint32_t PoseOf(const map::Keyframe& other) {
    const auto [pose, added] = pose_of_.try_emplace(other.id, static_cast<std::uint32_t>(problem_.poses.size()));
    if (!added) return pose->second;
    const auto [camera, unknown] =
        camera_of_.try_emplace(other.camera, static_cast<std::uint32_t>(problem_.cameras.size()));
    if (unknown) problem_.cameras.push_back(map_.pinhole(other.camera));
    problem_.poses.push_back({other.camera_from_map, camera->second, true});
    return pose->second;
  }

  const map::Snapshot& map_;
  optimization::BundleProblem problem_;
  std::unordered_map<PointId, std::uint32_t> point_of_;
  std::unordered_map<KeyframeId, std::uint32_t> pose_of_;
  std::unordered_map<CameraId, std::uint32_t> camera_of_;
};

// How far apart in the world, and by which turn, the two components' alignments put the camera of `keyframe`. Nothing
// if not both are aligned.
std::optional<WorldGap> GapInWorld(const map::Snapshot& map, const map::Keyframe& keyframe, ComponentId other,
                                   const Sim3& other_from_own) {
  const std::optional<Sim3>& world_from_own = map.WorldFrom(keyframe.component);
  const std::optional<Sim3>& world_from_other = map.WorldFrom(other);
  if (!world_from_own || !world_from_other) return std::nullopt;
  const Vector3d center = keyframe.CenterInMap();
  const Sim3 by_join = *world_from_other * other_from_own;
  const Quaterniond turn = by_join.rotation() * world_from_own->rotation().conjugate();
  return WorldGap{(by_join * center - *world_from_own * center).norm(), kDegPerRad * AngleRad(turn)};
}

}  // namespace

absl::Status JoinOptions::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("component join: ", what)); };
  CAIRN_RETURN_IF_ERROR(overlap.Validate());
  CAIRN_RETURN_IF_ERROR(lens.Validate());
  if (!(log_focal_sigma > 0.0)) return bad("log_focal_sigma must be positive");
  if (min_sightings < 1 || remembered < min_sightings)
    return bad("remembered must be at least min_sightings, and that 1");
  if (!(min_share >= 0.0 && min_share <= 1.0)) return bad("min_share must be in [0, 1]");
  if (!(max_rival_share > 0.0 && max_rival_share <= 1.0)) return bad("max_rival_share must be in (0, 1]");
  if (max_verified < 1) return bad("max_verified must be at least 1");
  if (max_seam_keyframes < 1 || seam_iterations < 1) return bad("the seam needs at least one keyframe and iteration");
  return absl::OkStatus();
}

absl::StatusOr<ComponentJoiner> ComponentJoiner::Create(const JoinOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  return ComponentJoiner(options);
}

// Rivals are a matter of several findings here (IsRivalled).
ComponentJoiner::ComponentJoiner(const JoinOptions& options)
    : options_(options), relocalizer_(tracking::RelocalizerOptions::WithoutRivals()) {}

absl::StatusOr<ComponentJoiner::Sighting> ComponentJoiner::Look(const tracking::MapView& view,
                                                                const map::Keyframe& keyframe) const {
  const map::Snapshot& map = view.map();
  Sighting sighting;
  sighting.keyframe = keyframe.id;
  sighting.own = keyframe.component;
  CAIRN_ASSIGN_OR_RETURN(
      const tracking::Relocalization found,
      relocalizer_.Relocalize(map, *view.places(), map.pinhole(keyframe.camera), keyframe.features->features,
                              tracking::SearchArea::Except(keyframe.component)));
  sighting.calibration_doubted = found.place.focal_factor != 1.0;
  if (!found.localized) return sighting;
  sighting.other = map.keyframe(found.place.reference_keyframe).component;
  sighting.camera_from_other = found.place.camera_from_map;
  sighting.reference = found.place.reference_keyframe;
  std::vector<double> depths;
  for (const tracking::PointObservation& inlier : found.place.inliers) {
    sighting.matches.push_back({inlier.feature, inlier.point});
    depths.push_back((found.place.camera_from_map * map.point(inlier.point).position).z());
  }
  sighting.median_depth = Median(std::move(depths));
  return sighting;
}

// Those of the same two components, most matches with points on both sides first: a keyframe gets points of its own
// with those that follow it. Both keyframes must still be there.
std::vector<const ComponentJoiner::Sighting*> ComponentJoiner::BestSightings(const map::Snapshot& map,
                                                                             const Sighting& newest) const {
  std::vector<std::pair<int, const Sighting*>> ranked;
  for (const Sighting& sighting : sightings_) {
    const map::Keyframe* keyframe = map.keyframes().Find(sighting.keyframe);
    if (keyframe == nullptr || sighting.own != newest.own || sighting.other != newest.other) continue;
    if (!map.keyframes().Contains(sighting.reference)) continue;
    const auto complete = std::ranges::count_if(sighting.matches, [&](const LoopMatch& match) {
      return keyframe->points[match.feature].valid() && map.points().Contains(match.point);
    });
    ranked.emplace_back(-static_cast<int>(complete), &sighting);
  }
  std::stable_sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<const Sighting*> best;
  for (const auto& [complete, sighting] : ranked) {
    if (static_cast<int>(best.size()) < options_.max_verified) best.push_back(sighting);
  }
  return best;
}

// Whether lately another component was seen about as often: a place that looks like this one.
bool ComponentJoiner::IsRivalled(const Sighting& sighting) const {
  std::map<ComponentId, int> seen;
  for (const Sighting& other : sightings_) {
    if (other.other && other.own == sighting.own) ++seen[other.other];
  }
  const int here = seen[sighting.other];
  return std::ranges::any_of(seen, [&](const auto& entry) {
    return entry.first != sighting.other && entry.second >= options_.max_rival_share * here;
  });
}

// Whether what was seen lately is where the similarity of the newest puts it.
bool ComponentJoiner::SightingsAgree(const map::Snapshot& map, const Sighting& newest, const Loop& overlap,
                                     JoinReport* report) const {
  const Sim3 other_from_own = OtherFromOwn(map, overlap);
  const Sim3 own_from_other = other_from_own.Inverse();
  for (const Sighting& sighting : sightings_) {
    const map::Keyframe* keyframe = map.keyframes().Find(sighting.keyframe);
    if (keyframe == nullptr || sighting.own != newest.own || sighting.other != newest.other) continue;
    ++report->sightings_checked;
    const SE3 predicted = RigidPart(Sim3(keyframe->camera_from_map) * own_from_other);
    const SE3 difference = predicted * sighting.camera_from_other.Inverse();
    const bool agrees = kDegPerRad * AngleRad(difference.rotation()) <= options_.overlap.max_neighbour_turn_deg &&
                        difference.translation().norm() <= options_.overlap.max_neighbour_shift * sighting.median_depth;
    report->sightings_agreeing += agrees ? 1 : 0;
  }
  return report->sightings_agreeing >= options_.min_sightings &&
         report->sightings_agreeing >= options_.min_share * report->sightings_checked;
}

// Whether two components that are both aligned to the world are there where the overlap puts them.
bool ComponentJoiner::AlignmentsAgree(const map::Snapshot& map, const Loop& overlap, JoinReport* report) const {
  const map::Keyframe& current = map.keyframe(overlap.current);
  const ComponentId other = map.keyframe(overlap.loop).component;
  const auto gap = GapInWorld(map, current, other, OtherFromOwn(map, overlap));
  report->gap = gap;
  if (!gap) return true;
  std::vector<double> depths;
  for (const LoopMatch& match : overlap.matches) {
    depths.push_back((map.keyframe(overlap.loop).camera_from_map * map.point(match.point).position).z());
  }
  const double depth = map.WorldFrom(other)->scale() * Median(std::move(depths));
  if (gap->shift <= options_.overlap.max_neighbour_shift * depth &&
      gap->turn_deg <= options_.overlap.max_neighbour_turn_deg) {
    return true;
  }
  report->rejected = "both are aligned to the world, but not to the same place in it: align one anew";
  return false;
}

// Whether a camera that the other component does not know sees its points as it is calibrated. A focal length that is
// wrong bends what is mapped with it, and would be believed from then on.
bool ComponentJoiner::CameraFits(const map::Snapshot& map, const Sighting& newest, JoinReport* report) const {
  const CameraId camera = map.keyframe(newest.keyframe).camera;
  CameraProblem views(map, map.pinhole(camera));
  for (const Sighting& sighting : sightings_) {
    const map::Keyframe* keyframe = map.keyframes().Find(sighting.keyframe);
    if (keyframe == nullptr || sighting.own != newest.own || sighting.other != newest.other) continue;
    if (keyframe->camera == camera) views.Add(*keyframe, sighting.camera_from_other, sighting.matches);
  }
  const optimization::BundleProblem& problem = views.problem();
  optimization::LensAdjustmentOptions prior;
  prior.log_focal_sigma = options_.log_focal_sigma;
  const auto result =
      optimization::AdjustLens(problem, 0, std::vector<std::uint8_t>(problem.observations.size(), 1), prior);
  if (!result.ok()) return true;  // too little to tell
  const LensReport lens = JudgeLens(*result, map.pinhole(camera), options_.lens);
  if (!lens.another_camera || lens.gain < options_.lens.min_gain) return true;
  report->rejected = kCalibrationRefused;
  return false;
}

// What happens once the overlap is proven.
class ComponentJoiner::Join {
 public:
  Join(const JoinOptions& options, const Loop& overlap, std::shared_ptr<const map::Snapshot> map)
      : options_(options), overlap_(overlap), map_(*map), edit_(std::move(map)) {}

  absl::Status Run(std::int64_t wall_clock_ns, MapHead& head, JoinReport* report) {
    Move(wall_clock_ns, report);
    std::vector<KeyframeId> here = {overlap_.current};
    for (const KeyframeId id : map::BestCovisible(map_.keyframe(overlap_.current))) here.push_back(id);
    report->fused_points = FuseSides(overlap_, here, overlap_.loop_side, options_.overlap, edit_).points;
    for (const KeyframeId id : here) edit_.UpdateCovisibility(id);
    CAIRN_RETURN_IF_ERROR(AdjustSeam());
    const SessionId session = map_.keyframe(overlap_.current).session;
    Touch(session, report->into, &edit_);
    edit_.SetSession(session);
    return head.Commit(
        edit_.Finish(absl::StrCat("join component ", report->component.value(), " to ", report->into.value())),
        scales_);
  }

 private:
  void Move(std::int64_t wall_clock_ns, JoinReport* report) {
    const map::Keyframe &current = map_.keyframe(overlap_.current), &other = map_.keyframe(overlap_.loop);
    const Sim3 other_from_own = OtherFromOwn(map_, overlap_);
    const bool own_moves = other.component < current.component;  // the younger one
    const map::Keyframe &moving = own_moves ? current : other, &staying = own_moves ? other : current;
    map::ComponentJoin join;
    join.into = staying.component;
    join.into_from_component = own_moves ? other_from_own : other_from_own.Inverse();
    join.keyframe = moving.id;
    join.into_keyframe = staying.id;
    join.keyframe_time_ns = moving.time_ns;
    join.matches = report->evidence.guided_matches;
    join.keyframes_agreeing = report->evidence.neighbours_agreeing + report->sightings_agreeing;
    join.keyframes_checked = report->evidence.neighbours_checked + report->sightings_checked;
    join.revision = map_.revision() + 1;
    join.joined_unix_ns = wall_clock_ns;
    map_.keyframes().ForEach([&](const auto& keyframe) {
      if (keyframe->component != moving.component) return;
      moved_.insert(keyframe->id);
      scales_[keyframe->id] = join.into_from_component.scale();
    });
    seam_ = moving.id;
    report->component = moving.component;
    report->into = staying.component;
    report->scale = join.into_from_component.scale();
    edit_.JoinComponent(moving.component, join);
  }

  // The side that moved is fitted to the one that stays, which holds it.
  absl::Status AdjustSeam() {
    LocalAdjustmentOptions adjustment;
    adjustment.first_iterations = options_.seam_iterations;
    adjustment.second_iterations = options_.seam_iterations;
    adjustment.max_fixed_keyframes = 0;
    const auto free = Around(edit_, seam_, static_cast<std::size_t>(options_.max_seam_keyframes), moved_);
    const absl::Status adjusted = AdjustKeyframes(edit_, free, adjustment).status();
    return absl::IsInternal(adjusted) ? absl::OkStatus() : adjusted;  // no better answer: as the similarity put it
  }

  const JoinOptions& options_;
  const Loop& overlap_;
  const map::Snapshot& map_;  // kept alive by the edit
  map::Edit edit_;
  KeyframeId seam_;
  std::unordered_set<KeyframeId> moved_;
  KeyframeScales scales_;
};

absl::StatusOr<JoinReport> ComponentJoiner::Process(KeyframeId keyframe_id, std::int64_t wall_clock_ns, MapHead& head) {
  const std::shared_ptr<const tracking::MapView> view = head.View();
  const map::Snapshot& map = view->map();
  if (view->places() == nullptr) return absl::FailedPreconditionError("component join: the map has no vocabulary");
  const map::Keyframe* keyframe = map.keyframes().Find(keyframe_id);
  if (keyframe == nullptr) {
    return absl::NotFoundError(absl::StrCat("component join: the map has no keyframe ", keyframe_id.value()));
  }
  JoinReport report;
  report.current = keyframe_id;
  if (map.LiveComponents().size() < 2) {
    sightings_.clear();
    return report;
  }
  report.searched = true;
  Stopwatch watch;
  CAIRN_ASSIGN_OR_RETURN(Sighting sighting, Look(*view, *keyframe));
  report.search_ms = watch.LapMs();
  report.calibration_doubted = sighting.calibration_doubted;
  sightings_.push_back(sighting);
  while (static_cast<int>(sightings_.size()) > options_.remembered) sightings_.pop_front();
  if (!sighting.other) return report;
  report.seen = true;
  report.seen_in = sighting.other;

  if (IsRivalled(sighting)) {
    report.rejected = "two components look alike here";
    return report;
  }
  std::optional<Loop> overlap;
  for (const Sighting* candidate : BestSightings(map, sighting)) {
    overlap = VerifyOverlap(map, candidate->keyframe, candidate->reference, candidate->matches, options_.overlap,
                            &report.evidence);
    report.sightings_agreeing = report.sightings_checked = 0;
    if (!overlap) {
      report.rejected = report.evidence.rejected;
    } else if (!SightingsAgree(map, sighting, *overlap, &report)) {
      report.rejected = "too few keyframes found there agree";
    } else {
      report.rejected.clear();
      break;
    }
  }
  if (report.rejected.empty() && AlignmentsAgree(map, *overlap, &report)) {
    CameraFits(map, sighting, &report);
  }
  report.verify_ms = watch.LapMs();
  if (!report.rejected.empty()) return report;

  CAIRN_RETURN_IF_ERROR(Join(options_, *overlap, view->snapshot()).Run(wall_clock_ns, head, &report));
  report.join_ms = watch.LapMs();
  report.joined = true;
  sightings_.clear();
  return report;
}

}  // namespace cairn::mapping

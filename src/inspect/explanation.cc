#include "inspect/explanation.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"
#include "inspect/measures.h"

namespace cairn::inspect {
namespace {

using tracking::RelocalizationStage;

// Beyond these, features of two views are hardly the same any more: ORB's descriptors bear a change of the view of some
// 30 degrees, and of the scale by what the pyramid spans.
constexpr double kFarAsideDeg = 30.0;
constexpr double kFarAwayShare = 0.7;

// Which got further.
bool Further(const tracking::TracedGroup& a, const tracking::TracedGroup& b) {
  if (a.tried != b.tried) return a.tried;
  if (a.attempt.stage != b.attempt.stage) return a.attempt.stage > b.attempt.stage;
  if (a.attempt.counts.inliers != b.attempt.counts.inliers) return a.attempt.counts.inliers > b.attempt.counts.inliers;
  return a.matches.size() > b.matches.size();
}

void TakePose(const map::Snapshot& map, const tracking::SearchArea& area, Explanation* explanation) {
  const auto take = [&](const tracking::FoundPlace& place) {
    explanation->has_pose = true;
    explanation->component = map.keyframe(place.reference_keyframe).component;
    explanation->camera_from_map = place.camera_from_map;
  };
  if (explanation->result.localized) {
    take(explanation->result.place);
  } else if (!area.priors.empty()) {
    explanation->has_pose = explanation->pose_is_given = true;
    explanation->component = area.priors[0].component;
    explanation->camera_from_map = area.priors[0].map_from_camera.Inverse();
  } else if (!explanation->result.rivals.empty()) {
    take(explanation->result.rivals[0]);
  } else if (explanation->best_group >= 0) {
    const auto& attempt = explanation->trace.groups[static_cast<std::size_t>(explanation->best_group)].attempt;
    if (attempt.place.reference_keyframe) take(attempt.place);
  }
}

std::vector<NearKeyframe> Nearest(const map::Snapshot& map, const Explanation& explanation, int count) {
  std::vector<std::pair<double, NearKeyframe>> all;
  const Vector3d center = explanation.camera_from_map.Inverse().translation();
  const double scale = PlacedScale(map, explanation.component);
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (keyframe->component != explanation.component) return;
    NearKeyframe near;
    near.keyframe = keyframe->id;
    const double distance = (keyframe->CenterInMap() - center).norm();
    near.distance = scale * distance;
    near.angle_deg = AxisAngleDeg(keyframe->camera_from_map, explanation.camera_from_map);
    all.push_back({distance, near});
  });
  if (all.empty()) return {};
  // Alike are views whose distance and turn are small together, each in proportion to what still looks alike.
  std::vector<NearKeyframe> nearest;
  for (auto& [cost, near] : all) {
    const double depth = MedianDepth(Measure(map, map.keyframe(near.keyframe)));
    near.distance_share = depth > 0.0 ? cost / depth : 0.0;
    cost = near.distance_share / kFarAwayShare + near.angle_deg / kFarAsideDeg;
  }
  std::ranges::stable_sort(all, {}, [](const auto& entry) { return entry.first; });
  for (std::size_t i = 0; i < std::min(all.size(), static_cast<std::size_t>(count)); ++i)
    nearest.push_back(all[i].second);
  return nearest;
}

// What keyframes of the map have.
double MeanFeatures(const map::Snapshot& map) {
  double sum = 0.0;
  map.keyframes().ForEach([&](const auto& keyframe) { sum += static_cast<double>(keyframe->points.size()); });
  return map.keyframes().empty() ? 0.0 : sum / static_cast<double>(map.keyframes().size());
}

void AdviseOnView(const Explanation& explanation, std::vector<std::string>* advice) {
  if (explanation.near.empty()) return;
  const NearKeyframe& near = explanation.near[0];
  const char* whose = explanation.pose_is_given ? "the given pose" : "where the image seems to be";
  if (near.angle_deg > kFarAsideDeg) {
    advice->push_back(absl::StrFormat(
        "the nearest keyframe to %s, %u, looks %.0f degrees aside: map more there, looking in that direction", whose,
        near.keyframe.value(), near.angle_deg));
  } else if (near.distance_share > kFarAwayShare) {
    advice->push_back(absl::StrFormat(
        "the nearest keyframe to %s, %u, is %.1f times the distance of what it sees away: map from nearer", whose,
        near.keyframe.value(), near.distance_share));
  } else if (!explanation.result.localized) {
    advice->push_back(
        absl::StrFormat("keyframe %u is near %s and looks the same way (%.0f degrees aside): the place, the light or "
                        "the camera may have "
                        "changed since; map it again with run --extend",
                        near.keyframe.value(), whose, near.angle_deg));
  }
}

void Advise(const map::Snapshot& map, Explanation* explanation) {
  const tracking::Relocalization& result = explanation->result;
  std::vector<std::string>* advice = &explanation->advice;
  const double usual = MeanFeatures(map);
  if (result.counts.features < 0.5 * usual) {
    advice->push_back(absl::StrFormat(
        "the image has %d features, keyframes of this map %.0f: it is dark, blurred, covered, or shows little texture",
        result.counts.features, usual));
  }
  switch (result.stage) {
    case RelocalizationStage::kFeatures:
      break;
    case RelocalizationStage::kCandidates:
      if (map.keyframes().empty()) {
        advice->push_back("there is nothing in the map: cairn run --extend maps into it");
        break;
      }
      advice->push_back("nothing in the map looks like it: it shows another place, or the map has few keyframes there");
      break;
    case RelocalizationStage::kMatches:
      advice->push_back(
          "no group of keyframes has matches enough: most likely the map does not show this place, or only from far "
          "aside; where it should, map more views there");
      break;
    case RelocalizationStage::kPnp:
      advice->push_back(
          "features look alike but do not agree on a pose: another place with the same things, or a wrong calibration "
          "(--camera: size, focal length, distortion)");
      break;
    case RelocalizationStage::kRefinement:
      if (result.counts.visible_cells > 2 * result.counts.cells) {
        advice->push_back(absl::StrFormat(
            "points are found in %d of the %d parts of the image that should show some: something stands before the "
            "rest, it has changed, or the place only looks alike",
            result.counts.cells, result.counts.visible_cells));
      }
      break;
    case RelocalizationStage::kRivals:
      advice->push_back("several places of the map look like it: a rough pose (--prior) tells them apart");
      break;
    case RelocalizationStage::kDone:
      if (!result.beyond_doubt) {
        advice->push_back(absl::StrFormat("found, but with little to spare: %d inliers in %d of %d parts of the image",
                                          result.counts.inliers, result.counts.cells, result.counts.visible_cells));
      }
      break;
  }
  if (result.localized && result.place.focal_factor != 1.0) {
    advice->push_back(
        absl::StrFormat("the matches contradict the calibration: they ask for a focal length of %.3f times it",
                        result.place.focal_factor));
  }
  if (!result.localized || !result.beyond_doubt) AdviseOnView(*explanation, advice);
}

}  // namespace

const char* StageName(RelocalizationStage stage) {
  switch (stage) {
    case RelocalizationStage::kFeatures:
      return "features";
    case RelocalizationStage::kCandidates:
      return "candidates";
    case RelocalizationStage::kMatches:
      return "matches";
    case RelocalizationStage::kPnp:
      return "pnp";
    case RelocalizationStage::kRefinement:
      return "refinement";
    case RelocalizationStage::kRivals:
      return "rivals";
    case RelocalizationStage::kDone:
      return "done";
  }
  return "";
}

absl::StatusOr<Explanation> Explain(const tracking::MapView& view, const Pinhole& pinhole,
                                    const image::Features& features, const tracking::SearchArea& area,
                                    const ExplainOptions& options) {
  if (view.places() == nullptr) {
    return absl::FailedPreconditionError("the map has no vocabulary, so that no place can be found in it");
  }
  const map::Snapshot& map = view.map();
  Explanation explanation;
  CAIRN_ASSIGN_OR_RETURN(explanation.result, tracking::RelocalizeTraced(options.relocalizer, map, *view.places(),
                                                                        pinhole, features, area, &explanation.trace));
  CAIRN_RETURN_IF_ERROR(StatusOfRead(map));
  const auto& groups = explanation.trace.groups;
  if (!groups.empty()) {
    const auto best = std::ranges::max_element(groups, [](const auto& a, const auto& b) { return Further(b, a); });
    explanation.best_group = static_cast<int>(best - groups.begin());
  }
  TakePose(map, area, &explanation);
  if (explanation.has_pose) explanation.near = Nearest(map, explanation, options.near_keyframes);
  Advise(map, &explanation);
  CAIRN_RETURN_IF_ERROR(StatusOfRead(map));
  return explanation;
}

}  // namespace cairn::inspect

#include "tracking/relocalizer.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "tracking/candidate_groups.h"
#include "tracking/pose_attempt.h"

namespace cairn::tracking {
namespace {

constexpr int kSharedPoints = 5;        // of the points found, that a keyframe of the same place sees
constexpr double kMinRivalScore = 0.3;  // share of the best group's score below which a group is no rival
constexpr double kRivalMatches = 0.5;   // of max_rival_share: the share of matches below which it is not tried
constexpr double kSameDistance = 0.1;   // two poses nearer than this share of the depth of the scene ...
constexpr double kSameAngleDeg = 10.0;  // ... and than this are one place

// Which of two attempts got further.
bool Better(const Relocalization& a, const Relocalization& b) {
  if (a.stage != b.stage) return a.stage > b.stage;
  if (a.counts.inliers != b.counts.inliers) return a.counts.inliers > b.counts.inliers;
  if (a.counts.pnp_inliers != b.counts.pnp_inliers) return a.counts.pnp_inliers > b.counts.pnp_inliers;
  return a.counts.word_matches > b.counts.word_matches;
}

ComponentId ComponentOf(const map::Snapshot& map, const FoundPlace& place) {
  return map.keyframe(place.reference_keyframe).component;
}

bool SamePlace(const map::Snapshot& map, const FoundPlace& a, const FoundPlace& b) {
  if (ComponentOf(map, a) != ComponentOf(map, b)) return false;
  const SE3 a_from_b = a.camera_from_map * b.camera_from_map.Inverse();
  return a_from_b.translation().norm() <= kSameDistance * std::max(a.fit.median_depth, b.fit.median_depth) &&
         AngleRad(a_from_b.rotation()) <= kSameAngleDeg * std::numbers::pi / 180.0;
}

// The keyframes that see some of what was found.
std::unordered_set<KeyframeId> KeyframesThere(const map::Snapshot& map, const FoundPlace& place) {
  std::unordered_map<KeyframeId, int> shared;
  for (const PointObservation& inlier : place.inliers) {
    for (const map::Observation& observation : map.point(inlier.point).observations) ++shared[observation.keyframe];
  }
  std::unordered_set<KeyframeId> keyframes;
  for (const auto& [id, count] : shared) {
    if (count >= kSharedPoints) keyframes.insert(id);
  }
  return keyframes;
}

// The search for one image.
class PlaceSearch {
 public:
  PlaceSearch(const ImageQuery& query, const RelocalizerOptions& options, const SearchArea& area)
      : query_(query), options_(options), area_(area) {
    miss_.counts.features = static_cast<int>(query.features.size());
  }

  absl::StatusOr<Relocalization> Run() {
    const auto candidates = Candidates({});
    miss_.counts.candidates = static_cast<int>(candidates.size());
    const std::vector<CandidateGroup> groups = FormGroups(query_.map, candidates, options_.group_size);
    if (groups.empty()) {
      miss_.stage = RelocalizationStage::kCandidates;
      miss_.reason = area_.priors.empty() ? "no keyframe of the map shares a word with the image"
                                          : "no keyframe near the prior shares a word with the image";
      return std::move(miss_);
    }
    CAIRN_RETURN_IF_ERROR(Find(SelectGroups(groups, options_.max_groups, options_.min_group_score * groups[0].score)));
    if (found_.empty()) return std::move(miss_);
    if (options_.max_rivals > 0) CAIRN_RETURN_IF_ERROR(AskRivals(groups, candidates.size()));
    return Result();
  }

 private:
  std::vector<place::Candidate> Candidates(const std::unordered_set<KeyframeId>& taken) const {
    place::QueryOptions wanted;
    wanted.min_common_share = 0.0;
    wanted.max_results = static_cast<std::size_t>(options_.max_candidate_keyframes);
    if (area_.only || area_.except || !area_.priors.empty() || !taken.empty()) {
      wanted.exclude = [&](std::uint32_t id) {
        return taken.contains(KeyframeId(id)) || !area_.MayShareView(query_.map, query_.map.keyframe(KeyframeId(id)));
      };
    }
    return query_.places.Query(query_.words.bow, wanted);
  }

  std::vector<GroupMatch> Match(const CandidateGroup& group) const {
    return MatchGroup(query_.map, query_.places, group.keyframes, query_.features, query_.words.nodes,
                      options_.matching);
  }

  // Keeps what is found, or what got furthest.
  absl::Status Try(const CandidateGroup& group, const std::vector<GroupMatch>& matches) {
    RelocalizationCounts counts;
    counts.features = miss_.counts.features;
    counts.candidates = miss_.counts.candidates;
    CAIRN_ASSIGN_OR_RETURN(Relocalization attempt,
                           AttemptPose(query_, group.keyframes[0], matches, tried_++, counts, options_));
    if (attempt.localized) CheckPrior(&attempt);
    if (!attempt.localized) {
      if (miss_.reason.empty() || Better(attempt, miss_)) miss_ = std::move(attempt);
      return absl::OkStatus();
    }
    const auto same = std::ranges::find_if(
        found_, [&](const Relocalization& other) { return SamePlace(query_.map, other.place, attempt.place); });
    if (same == found_.end()) {
      found_.push_back(std::move(attempt));
    } else if (attempt.counts.inliers > same->counts.inliers) {
      *same = std::move(attempt);
    }
    return absl::OkStatus();
  }

  void CheckPrior(Relocalization* attempt) const {
    const double sigmas =
        area_.SigmasFrom(ComponentOf(query_.map, attempt->place), attempt->place.camera_from_map.Inverse());
    if (sigmas <= kMaxPriorSigmas) return;
    attempt->localized = attempt->beyond_doubt = false;
    attempt->stage = RelocalizationStage::kRefinement;
    attempt->reason = absl::StrCat("the image fits the map where keyframe ", attempt->place.reference_keyframe.value(),
                                   " is, ", std::lround(std::min(sigmas, 1e6)),
                                   " standard deviations from the prior, at most ", kMaxPriorSigmas, " allowed");
  }

  // The best group; unless that is beyond doubt, the others, most matches first.
  absl::Status Find(const std::vector<CandidateGroup>& groups) {
    CAIRN_RETURN_IF_ERROR(Try(groups[0], Match(groups[0])));
    if (!found_.empty() && found_[0].beyond_doubt) return absl::OkStatus();
    std::vector<std::pair<const CandidateGroup*, std::vector<GroupMatch>>> others;
    for (std::size_t i = 1; i < groups.size(); ++i) others.emplace_back(&groups[i], Match(groups[i]));
    std::ranges::stable_sort(others, [](const auto& a, const auto& b) { return a.second.size() > b.second.size(); });
    for (const auto& [group, matches] : others) {
      if (tried_ >= static_cast<std::uint64_t>(options_.max_poses)) break;
      CAIRN_RETURN_IF_ERROR(Try(*group, matches));
      if (!found_.empty() && found_.back().beyond_doubt) break;
    }
    return absl::OkStatus();
  }

  // Other places that look like what was found, if they share words and matches enough.
  absl::Status AskRivals(const std::vector<CandidateGroup>& groups, std::size_t num_candidates) {
    const Relocalization& best = Best();
    const double min_matches = kRivalMatches * options_.max_rival_share * best.counts.word_matches;
    const double min_score = kMinRivalScore * groups[0].score;
    const std::unordered_set<KeyframeId> there = KeyframesThere(query_.map, best.place);
    std::vector<CandidateGroup> rivals = SelectGroups(groups, options_.max_rivals, min_score, there);
    // A place of many keyframes may be all that the candidates are.
    if (rivals.size() < static_cast<std::size_t>(options_.max_rivals) &&
        num_candidates == static_cast<std::size_t>(options_.max_candidate_keyframes)) {
      rivals = SelectGroups(FormGroups(query_.map, Candidates(there), options_.group_size), options_.max_rivals,
                            min_score, there);
    }
    for (const CandidateGroup& rival : rivals) {
      const std::vector<GroupMatch> matches = Match(rival);
      if (static_cast<double>(matches.size()) >= min_matches) CAIRN_RETURN_IF_ERROR(Try(rival, matches));
    }
    return absl::OkStatus();
  }

  const Relocalization& Best() const {
    return *std::ranges::max_element(found_, {}, [](const Relocalization& found) { return found.counts.inliers; });
  }

  Relocalization Result() {
    std::ranges::stable_sort(found_, std::ranges::greater(), [](const auto& found) { return found.counts.inliers; });
    const double rival_inliers = options_.max_rival_share * found_[0].counts.inliers;
    std::erase_if(found_, [&](const Relocalization& found) { return found.counts.inliers < rival_inliers; });
    if (found_.size() == 1 || options_.max_rivals == 0) return std::move(found_[0]);
    Relocalization ambiguous;
    ambiguous.stage = RelocalizationStage::kRivals;
    ambiguous.counts = found_[0].counts;
    ambiguous.reason = "places that look alike:";
    for (Relocalization& found : found_) {
      absl::StrAppend(&ambiguous.reason, ambiguous.rivals.empty() ? " " : ", or ", found.counts.inliers,
                      " inliers at keyframe ", found.place.reference_keyframe.value());
      ambiguous.rivals.push_back(std::move(found.place));
    }
    return ambiguous;
  }

  const ImageQuery& query_;
  const RelocalizerOptions& options_;
  const SearchArea& area_;
  std::vector<Relocalization> found_;  // each at a place of its own
  Relocalization miss_;                // that got furthest
  std::uint64_t tried_ = 0;
};

}  // namespace

absl::StatusOr<Relocalization> Relocalizer::Relocalize(const map::Snapshot& map, const PlaceIndex& places,
                                                       const Pinhole& pinhole, const image::Features& features,
                                                       const SearchArea& area) const {
  CAIRN_RETURN_IF_ERROR(options_.Validate());
  for (const PlacePrior& prior : area.priors) CAIRN_RETURN_IF_ERROR(prior.Validate());
  if (pinhole.width_px <= 0 || pinhole.height_px <= 0 || !(pinhole.fx_px > 0.0) || !(pinhole.fy_px > 0.0)) {
    return absl::InvalidArgumentError("relocalizer: the camera has no positive size and focal length");
  }
  if (places.revision() != map.revision()) {
    return absl::FailedPreconditionError(absl::StrCat("relocalizer: the places are of revision ", places.revision(),
                                                      ", the map of revision ", map.revision()));
  }
  if (static_cast<int>(features.size()) < options_.min_features) {
    Relocalization miss;
    miss.counts.features = static_cast<int>(features.size());
    miss.reason = absl::StrCat(features.size(), " features in the image, at least ", options_.min_features, " needed");
    return miss;
  }
  const ImageQuery query{map,
                         places,
                         pinhole,
                         features,
                         image::FeatureGrid(features.keypoints, pinhole.width_px, pinhole.height_px),
                         places.Transform(features.descriptors)};
  return PlaceSearch(query, options_, area).Run();
}

}  // namespace cairn::tracking

#include "tracking/relocalizer.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <span>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "tracking/candidate_groups.h"
#include "tracking/pose_attempt.h"
#include "tracking/relocalization_trace.h"

namespace cairn::tracking {
namespace {

constexpr int kSharedPoints = 5;        // of the points found, that a keyframe of the same place sees
constexpr int kNeighbours = 10;         // of each such keyframe, that are of the same place as well
constexpr double kMinRivalScore = 0.3;  // share of the best group's score below which a group is no rival
constexpr int kTriedRivals = 2;         // of the rivals, those with most matches
constexpr double kSharedMatches = 0.5;  // of the fewer matches of two poses: one place
constexpr double kSameDistance = 0.2;   // two poses nearer than this share of the depth of the scene ...
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

double Rounded(double factor) { return std::round(1000.0 * factor) / 1000.0; }

// How many features are matched with the same points.
std::size_t SharedMatches(const FoundPlace& a, const FoundPlace& b) {
  std::size_t shared = 0;
  for (auto i = a.inliers.begin(), j = b.inliers.begin(); i != a.inliers.end() && j != b.inliers.end();) {
    if (i->point != j->point) {
      ++(i->point < j->point ? i : j);
    } else {
      shared += (i++)->feature == (j++)->feature ? 1 : 0;
    }
  }
  return shared;
}

// Near each other; or two poses that the same matches allow, of which the one with more of them is right.
bool SamePlace(const map::Snapshot& map, const FoundPlace& a, const FoundPlace& b) {
  if (ComponentOf(map, a) != ComponentOf(map, b)) return false;
  const auto fewer = static_cast<double>(std::min(a.inliers.size(), b.inliers.size()));
  if (static_cast<double>(SharedMatches(a, b)) >= kSharedMatches * fewer) return true;
  const SE3 a_from_b = a.camera_from_map * b.camera_from_map.Inverse();
  return a_from_b.translation().norm() <= kSameDistance * std::max(a.fit.median_depth, b.fit.median_depth) &&
         AngleRad(a_from_b.rotation()) <= kSameAngleDeg * std::numbers::pi / 180.0;
}

// Of two attempts at one place, what the one with fewer matches has found out about the calibration: it may have asked
// better ones.
void ShareDoubt(const FoundPlace& from, FoundPlace* to) {
  if (from.focal_factor == 1.0 || to->focal_factor != 1.0) return;
  to->focal_factor = from.focal_factor;
  to->covariance += from.covariance;
}

// The keyframes that see some of what was found, and their neighbours.
std::unordered_set<KeyframeId> KeyframesThere(const map::Snapshot& map, const FoundPlace& place) {
  std::unordered_map<KeyframeId, int> shared;
  for (const PointObservation& inlier : place.inliers) {
    for (const map::Observation& observation : map.point(inlier.point).observations) ++shared[observation.keyframe];
  }
  std::unordered_set<KeyframeId> keyframes;
  for (const auto& [id, count] : shared) {
    if (count < kSharedPoints) continue;
    keyframes.insert(id);
    for (const KeyframeId neighbour : map::BestCovisible(map.keyframe(id), kNeighbours)) keyframes.insert(neighbour);
  }
  return keyframes;
}

// The search for one image.
class PlaceSearch {
 public:
  PlaceSearch(const ImageQuery& query, const RelocalizerOptions& options, const SearchArea& area,
              RelocalizationTrace* trace)
      : query_(query), options_(options), area_(area), trace_(trace) {
    miss_.counts.features = static_cast<int>(query.features.size());
  }

  absl::StatusOr<Relocalization> Run() {
    scores_ = query_.places.ScoreBounded(query_.words);
    const auto candidates = Candidates({});
    miss_.counts.candidates = static_cast<int>(candidates.size());
    if (trace_ != nullptr) trace_->candidates = candidates;
    const std::vector<CandidateGroup> groups = FormGroups(query_.map, candidates, options_.group_size);
    if (groups.empty()) {
      miss_.stage = RelocalizationStage::kCandidates;
      miss_.reason = query_.map.keyframes().empty() ? "the map has no keyframes"
                     : area_.priors.empty()         ? "no keyframe of the map shares a word with the image"
                                                    : "no keyframe near the prior shares a word with the image";
      return std::move(miss_);
    }
    CAIRN_RETURN_IF_ERROR(Find(SelectGroups(groups, options_.max_groups, options_.min_group_score * groups[0].score)));
    if (found_.empty()) {
      DoubtCalibration();
      return std::move(miss_);
    }
    if (options_.max_rivals > 0) CAIRN_RETURN_IF_ERROR(AskRivals(groups, candidates.size()));
    return Result();
  }

 private:
  std::vector<place::Candidate> Candidates(const std::unordered_set<KeyframeId>& taken) const {
    place::QueryOptions wanted;
    wanted.min_common_share = 0.0;
    wanted.max_results = static_cast<std::size_t>(options_.max_candidate_keyframes);
    // Keyframes are looked at only where that is the question: of a large map they come from the file.
    const bool bounded = area_.only || area_.except || !area_.priors.empty();
    if (bounded || !taken.empty()) {
      wanted.exclude = [&, bounded](std::uint32_t id) {
        const KeyframeId keyframe(id);
        return taken.contains(keyframe) || (bounded && !area_.MayShareView(query_.map, query_.map.keyframe(keyframe)));
      };
    }
    return query_.places.Best(scores_, wanted);
  }

  std::vector<GroupMatch> Match(const CandidateGroup& group) const {
    auto matches =
        MatchGroup(query_.map, query_.places, group.keyframes, query_.features, query_.words.nodes, options_.matching);
    if (trace_ != nullptr) trace_->groups.push_back({group.keyframes, matches, false, {}});
    return matches;
  }

  struct MatchedGroup {
    const CandidateGroup* group = nullptr;
    std::vector<GroupMatch> matches;
  };
  // Most matches first.
  std::vector<MatchedGroup> MatchAll(std::span<const CandidateGroup> groups) const {
    std::vector<MatchedGroup> matched;
    for (const CandidateGroup& group : groups) matched.push_back({&group, Match(group)});
    std::ranges::stable_sort(matched, std::ranges::greater(), [](const auto& entry) { return entry.matches.size(); });
    return matched;
  }

  // Keeps what is found, or what got furthest.
  absl::Status Try(const CandidateGroup& group, const std::vector<GroupMatch>& matches) {
    RelocalizationCounts counts;
    counts.features = miss_.counts.features;
    counts.candidates = miss_.counts.candidates;
    CAIRN_ASSIGN_OR_RETURN(Relocalization attempt,
                           AttemptPose(query_, group.keyframes[0], matches, tried_++, counts, options_));
    if (attempt.localized) CheckPrior(&attempt);
    Note(group, attempt);
    if (!attempt.localized) {
      if (miss_.reason.empty() || Better(attempt, miss_)) {
        miss_ = std::move(attempt);
        missed_matches_ = matches;
      }
      return absl::OkStatus();
    }
    const auto same = std::ranges::find_if(
        found_, [&](const Relocalization& other) { return SamePlace(query_.map, other.place, attempt.place); });
    if (same == found_.end()) {
      found_.push_back(std::move(attempt));
      return absl::OkStatus();
    }
    if (attempt.counts.inliers > same->counts.inliers) std::swap(attempt, *same);
    ShareDoubt(attempt.place, &same->place);
    return absl::OkStatus();
  }

  void Note(const CandidateGroup& group, const Relocalization& attempt) const {
    if (trace_ == nullptr) return;
    for (TracedGroup& traced : trace_->groups) {
      if (traced.tried || traced.keyframes != group.keyframes) continue;
      traced.tried = true;
      traced.attempt = attempt;
      return;
    }
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

  // Whether the image was missed for its calibration.
  void DoubtCalibration() {
    if (miss_.stage != RelocalizationStage::kPnp && miss_.stage != RelocalizationStage::kRefinement) return;
    const auto fit = FitWithAnotherCalibration(query_, missed_matches_, miss_.counts.pnp_inliers, options_);
    if (!fit) return;
    miss_.place.focal_factor = fit->focal_factor;
    miss_.reason = absl::StrCat("the calibration does not fit: with a focal length x ", Rounded(fit->focal_factor),
                                " the image fits the map where keyframe ", fit->reference.value(), " is, with ",
                                fit->inliers, " inliers; as it is, ", miss_.reason);
  }

  // The best group; unless that is beyond doubt, the others, most matches first.
  absl::Status Find(const std::vector<CandidateGroup>& groups) {
    CAIRN_RETURN_IF_ERROR(Try(groups[0], Match(groups[0])));
    if (!found_.empty() && found_[0].beyond_doubt) return absl::OkStatus();
    for (const MatchedGroup& other : MatchAll(std::span(groups).subspan(1))) {
      if (tried_ >= static_cast<std::uint64_t>(options_.max_poses)) break;
      CAIRN_RETURN_IF_ERROR(Try(*other.group, other.matches));
      if (!found_.empty() && found_.back().beyond_doubt) break;
    }
    return absl::OkStatus();
  }

  // Other places that look like what was found, if they share words and matches enough.
  absl::Status AskRivals(const std::vector<CandidateGroup>& groups, std::size_t num_candidates) {
    const Relocalization& best = Best();
    const double min_matches = options_.max_rival_share * best.counts.word_matches;
    const double min_score = kMinRivalScore * groups[0].score;
    const std::unordered_set<KeyframeId> there = KeyframesThere(query_.map, best.place);
    // A place of many keyframes may be all that the candidates are.
    const bool full = num_candidates == static_cast<std::size_t>(options_.max_candidate_keyframes);
    const std::vector<CandidateGroup> rivals =
        full ? SelectGroups(FormGroups(query_.map, Candidates(there), options_.group_size), options_.max_rivals,
                            min_score)
             : SelectGroups(groups, options_.max_rivals, min_score, there);
    auto matched = MatchAll(rivals);
    for (int i = 0; i < std::min(kTriedRivals, static_cast<int>(matched.size())); ++i) {
      if (static_cast<double>(matched[i].matches.size()) < min_matches) break;
      CAIRN_RETURN_IF_ERROR(Try(*matched[i].group, matched[i].matches));
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
  RelocalizationTrace* const trace_;        // null: nobody asks
  place::Scores scores_;                    // of the map's keyframes
  std::vector<Relocalization> found_;       // each at a place of its own
  Relocalization miss_;                     // that got furthest, ...
  std::vector<GroupMatch> missed_matches_;  // ... and what it was tried with
  std::uint64_t tried_ = 0;
};

}  // namespace

absl::StatusOr<Relocalization> Relocalizer::Relocalize(const map::Snapshot& map, const PlaceIndex& places,
                                                       const Pinhole& pinhole, const image::Features& features,
                                                       const SearchArea& area) const {
  return RelocalizeTraced(options_, map, places, pinhole, features, area, /*trace=*/nullptr);
}

absl::StatusOr<Relocalization> RelocalizeTraced(const RelocalizerOptions& options, const map::Snapshot& map,
                                                const PlaceIndex& places, const Pinhole& pinhole,
                                                const image::Features& features, const SearchArea& area,
                                                RelocalizationTrace* trace) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  for (const PlacePrior& prior : area.priors) CAIRN_RETURN_IF_ERROR(prior.Validate());
  if (pinhole.width_px <= 0 || pinhole.height_px <= 0 || !(pinhole.fx_px > 0.0) || !(pinhole.fy_px > 0.0)) {
    return absl::InvalidArgumentError("relocalizer: the camera has no positive size and focal length");
  }
  if (places.revision() != map.revision()) {
    return absl::FailedPreconditionError(absl::StrCat("relocalizer: the places are of revision ", places.revision(),
                                                      ", the map of revision ", map.revision()));
  }
  if (static_cast<int>(features.size()) < options.min_features) {
    Relocalization miss;
    miss.counts.features = static_cast<int>(features.size());
    miss.reason = absl::StrCat(features.size(), " features in the image, at least ", options.min_features, " needed");
    return miss;
  }
  const ImageQuery query{map,
                         places,
                         pinhole,
                         features,
                         image::FeatureGrid(features.keypoints, pinhole.width_px, pinhole.height_px),
                         places.Transform(features)};
  return PlaceSearch(query, options, area, trace).Run();
}

}  // namespace cairn::tracking

// Which motion explains a frame: alignment from several guesses, with what stands before the view left out, and against
// older keyframes; and which alignment is believed.
#include <algorithm>
#include <cmath>

#include "direct/alignment_check.h"
#include "direct/odometry_impl.h"
#include "direct/view_search.h"

namespace cairn::direct {
namespace {

constexpr double kGoodEnoughRmsRatio = 1.5;  // against the last frame: further hypotheses are not tried
constexpr double kMaxLogGain = 1.2;          // against the reference; a black image fits any gain
constexpr double kMaxBlankGainStep = 0.5;    // from one frame to the next where the image tells little
constexpr double kSureQuality = 0.8;         // from here on an alignment is believed without a second opinion
constexpr double kMinAgreement = 0.25;  // of the textured cells (see alignment_check.h): fewer and it is another place
constexpr int kMaxCarriedFrames = 2;    // in a row
// Of a frame that ends a loss or a gap, or follows one carried by the prediction.
constexpr double kMaxFoundSigmaPx = 1.0;
constexpr double kMinFoundAgreement = 0.55;
constexpr int kMinFoundCells = 5;
// Views with obstacles.
constexpr int kUncoverRounds = 2;
constexpr int kMinUncoveredCells = 6;    // that agree: fewer cannot carry an alignment
constexpr int kMatchReachPx = 3;         // of the level above the finest
constexpr int kSeenReachPx = 4;          // likewise
constexpr std::size_t kSeenGuesses = 4;  // the first of Hypotheses(): without turns
constexpr int kMinSeenCells = 5;
constexpr double kMinSeenShare = 0.8;              // of the cells found near that agree once aligned
constexpr std::size_t kMaxSearchedReferences = 4;  // of those most similar to a lost frame

}  // namespace

AlignmentAgreement Odometry::Impl::Agreement(const TrackingReference& reference, const FrameData& data,
                                             const SE3& new_from_reference) const {
  return AgreementOf(
      tracking_matcher_.Match(geometry_, reference, data.pyramid, new_from_reference, CellGrid::kReference, 0));
}

bool Odometry::Impl::Plausible(const TrackingReference& reference, const FrameData& data,
                               const TrackingOutcome& outcome) const {
  if (!outcome.converged || !outcome.new_from_reference.translation().allFinite()) return false;
  if (std::abs(outcome.light.a - reference.light.a) > kMaxLogGain) return false;
  if (outcome.good_share < 0.5 * options_.min_tracked_share || Fit(outcome) < options_.min_tracked_share) {
    return false;
  }
  // Whoever does not know where the camera is must not believe the first wall that looks alike.
  const bool carried = recent_.carried_frames > 0;
  if (recent_.unsure && outcome.weakest_sigma_px > kMaxFoundSigmaPx) return false;
  if (outcome.weakest_sigma_px > kCarriedSigmaPx) {
    // A blank wall fits any gain.
    if (recent_.carried_frames >= kMaxCarriedFrames ||
        std::abs(outcome.light.a - recent_.light.a) > kMaxBlankGainStep) {
      return false;
    }
  }
  if (!recent_.unsure && !carried && Fit(outcome) >= kSureQuality) return true;
  const AlignmentAgreement agreement = Agreement(reference, data, outcome.new_from_reference);
  if (recent_.unsure) return agreement.agreeing >= kMinFoundCells && agreement.share() >= kMinFoundAgreement;
  return (carried && agreement.cells == 0) || agreement.share() >= (carried ? kMinFoundAgreement : kMinAgreement);
}

// Share of the points in view that match.
double Odometry::Impl::Fit(const TrackingOutcome& outcome) const {
  if (outcome.visible_share <= 0.0) return 0.0;
  return std::clamp(outcome.good_share / outcome.visible_share, 0.0, 1.0);
}

// Of the pose: what the image leaves open counts against it.
double Odometry::Impl::Quality(const TrackingOutcome& outcome) const {
  return Fit(outcome) / (1.0 + outcome.weakest_sigma_px * outcome.weakest_sigma_px);
}

bool Odometry::Impl::AlignBest(const TrackingReference& reference, const FrameData& data,
                               const std::vector<SE3>& guesses, double sigma_px, double expected_rms,
                               TrackingOutcome* best) const {
  const LightPrior prior = PriorOf(data.frame, options_.affine_a_sigma, options_.affine_b_sigma_gray);
  double best_rms[kMaxLevels] = {};  // 0: not reached yet
  double give_up[kMaxLevels] = {};
  bool any = false;
  for (const SE3& guess : guesses) {
    double rms[kMaxLevels] = {};
    const TrackingOutcome outcome =
        tracker_.Align(reference, data, {guess, sigma_px}, recent_.light, prior, give_up, rms);
    if (Plausible(reference, data, outcome) && (!any || outcome.rms_gray < best->rms_gray)) {
      *best = outcome;
      any = true;
      for (int level = 0; level < geometry_.levels; ++level) best_rms[level] = rms[level];
    }
    for (int level = 0; level < geometry_.levels; ++level) {
      give_up[level] = any ? kGoodEnoughRmsRatio * best_rms[level] : 0.0;
    }
    if (any && (expected_rms <= 0.0 || best->rms_gray < kGoodEnoughRmsRatio * expected_rms)) break;
  }
  return any;
}

// Against the reference: as a whole, or what is seen of it. `guesses` are those of Hypotheses(); `covered` are the
// cells of the image where an obstacle was found.
bool Odometry::Impl::AlignView(const TrackingReference& reference, const FrameData& data,
                               const std::vector<SE3>& guesses, TrackingOutcome* outcome, CellSet* covered) {
  if (AlignBest(reference, data, guesses, recent_.unsure ? 0.0 : MotionSigmaPx(),
                recent_.unsure ? 0.0 : recent_.rms_gray, outcome)) {
    if (Fit(*outcome) < kSureQuality) *covered = AlignUncovered(reference, data, outcome);
    return true;
  }
  if (guesses.size() < kSeenGuesses) return false;
  if (!AlignSeenCells(reference, data, {guesses.data(), kSeenGuesses}, outcome)) return false;
  *covered = CoveredCells(reference, data, outcome->new_from_reference);
  return true;
}

// Against the last keyframes, most similar view first: where the camera was last seen, and turned as the images say.
bool Odometry::Impl::SearchReferences(std::span<const std::shared_ptr<const TrackingReference>> newest_first,
                                      const FrameData& data, TimeNs time_ns, TrackingOutcome* outcome,
                                      std::shared_ptr<const TrackingReference>* found) {
  const Thumbnail thumbnail = MakeThumbnail(data.pyramid, geometry_);
  std::vector<std::pair<ViewShift, std::shared_ptr<const TrackingReference>>> ranked;
  for (const auto& reference : newest_first) {
    ranked.emplace_back(FindShift(reference->thumbnail, thumbnail, geometry_), reference);
  }
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const auto& a, const auto& b) { return a.first.correlation > b.first.correlation; });
  if (ranked.size() > kMaxSearchedReferences) ranked.resize(kMaxSearchedReferences);
  for (const auto& [shift, reference] : ranked) {
    std::vector<SE3> guesses = {SE3(shift.new_from_reference, Vector3d::Zero())};
    const std::vector<SE3>& motions = Hypotheses(*reference, time_ns, false);
    guesses.insert(guesses.end(), motions.begin(), motions.end());
    if (AlignBest(*reference, data, guesses, 0.0, 0.0, outcome)) {
      *found = reference;
      return true;
    }
  }
  return false;
}

// Aligns what the reference shows outside of some of its cells; that part stays in uncovered_.
TrackingOutcome Odometry::Impl::AlignWithout(const CellSet& cells, const TrackingReference& reference,
                                             const FrameData& data, const SE3& guess, const AffineLight& light) {
  WithoutCells(geometry_, reference, cells, &uncovered_);
  const LightPrior prior = PriorOf(data.frame, options_.affine_a_sigma, options_.affine_b_sigma_gray);
  const double never[kMaxLevels] = {};
  double rms[kMaxLevels] = {};
  return tracker_.Align(uncovered_, data, {guess, MotionSigmaPx()}, light, prior, never, rms);
}

// Where an obstacle has come before a part of what the reference shows, that part is left out: if it is the larger one,
// it would hold the rest back. The quality still tells of the whole. Returns the cells of the image that show it.
CellSet Odometry::Impl::AlignUncovered(const TrackingReference& reference, const FrameData& data,
                                       TrackingOutcome* outcome) {
  CellSet covered = {};
  for (int round = 0; round < kUncoverRounds; ++round) {
    const AlignmentAgreement agreement = Agreement(reference, data, outcome->new_from_reference);
    const CellSet now = LargeRegions(agreement.disagreeing);
    if (now == covered || agreement.agreeing < kMinUncoveredCells) break;
    covered = now;
    const TrackingOutcome rest = AlignWithout(covered, reference, data, outcome->new_from_reference, outcome->light);
    if (!rest.converged || Fit(rest) < Fit(*outcome)) break;
    outcome->new_from_reference = rest.new_from_reference;
    outcome->light = rest.light;
    outcome->rms_gray = rest.rms_gray;
    outcome->flow_px = rest.flow_px;
    outcome->translation_flow_px = rest.translation_flow_px;
  }
  return covered == CellSet{} ? covered : CoveredCells(reference, data, outcome->new_from_reference);
}

// The cells of the image where something stands before what the reference shows.
CellSet Odometry::Impl::CoveredCells(const TrackingReference& reference, const FrameData& data,
                                     const SE3& new_from_reference) const {
  const CellMatches matches =
      tracking_matcher_.Match(geometry_, reference, data.pyramid, new_from_reference, CellGrid::kImage, kMatchReachPx);
  return LargeRegions(AgreementOf(matches).disagreeing);
}

// Where nothing explains the whole image: the cells whose pattern is found near to where a guess puts it, alone. With
// two thirds of the view behind an obstacle the rest is still enough.
bool Odometry::Impl::AlignSeenCells(const TrackingReference& reference, const FrameData& data,
                                    std::span<const SE3> guesses, TrackingOutcome* outcome) {
  for (const SE3& guess : guesses) {
    const CellMatches near =
        tracking_matcher_.Match(geometry_, reference, data.pyramid, guess, CellGrid::kReference, kSeenReachPx);
    CellSet unseen;
    for (std::size_t k = 0; k < unseen.size(); ++k) unseen[k] = near[k].correlation < kAgreeingCorrelation;
    const std::ptrdiff_t seen = std::count(unseen.begin(), unseen.end(), false);
    if (seen < kMinSeenCells) continue;
    const TrackingOutcome rest = AlignWithout(unseen, reference, data, guess, recent_.light);
    if (!rest.converged || rest.weakest_sigma_px > kCarriedSigmaPx || Fit(rest) < kSureQuality) continue;
    if (std::abs(rest.light.a - reference.light.a) > kMaxLogGain) continue;
    if (Agreement(uncovered_, data, rest.new_from_reference).agreeing < kMinSeenShare * seen) continue;
    *outcome = rest;
    outcome->good_share *= static_cast<double>(uncovered_.level[0].count) / std::max(1, reference.level[0].count);
    return true;
  }
  return false;
}

}  // namespace cairn::direct

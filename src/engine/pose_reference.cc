// Aligning a component by poses at the times of its keyframes.
#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "engine/alignment_target.h"

namespace cairn::engine {
namespace {

// Fewer residuals do not show their own spread: the error is many times what they claim.
constexpr std::size_t kMinPairs = 7;

// Recordings whose times all begin at 0 cannot be told apart by them.
std::string HintOfSessions(const map::Snapshot& map) {
  for (const auto& [id, session] : map.sessions()) {
    for (const auto& [other_id, other] : map.sessions()) {
      if (id < other_id && session.first_ns <= other.last_ns && other.first_ns <= session.last_ns) {
        return absl::StrCat(". Sessions ", id.value(), " and ", other_id.value(),
                            " have times in common: if the poses are of one of them, say so with --session");
      }
    }
  }
  return "";
}

// Everything that speaks against an alignment, or OK.
absl::Status Judge(const PoseAlignment& found, const AlignmentTarget& target,
                   const std::vector<AlignmentTarget>& targets, const api::AlignRequest& request) {
  std::vector<std::string> reasons;
  if (!request.force) {
    if (const absl::Status fits = CheckFits(found); !fits.ok()) reasons.emplace_back(fits.message());
    if (target.world_from_component) {
      const absl::Status same =
          CheckScaleAgainst(*target.world_from_component, found.a_from_b.scale(), found.RelativeScaleSigma());
      if (!same.ok()) reasons.emplace_back(same.message());
    }
  }
  const bool contradicted = !reasons.empty();
  if (const absl::Status determined = CheckDetermined(found); !determined.ok()) {
    reasons.emplace_back(determined.message());
  }
  if (reasons.empty()) return absl::OkStatus();
  if (found.orientations.inverted) {
    reasons.emplace_back(
        "its orientations agree with the camera's the other way round: does it hold camera_from_world?");
  }
  std::string help;
  if (contradicted) {
    help = " Is it the trajectory of the mapped recording, with its clock? --force aligns to it all the same.";
  }
  for (const AlignmentTarget& other : targets) {
    if (other.component == target.component || other.pairs.empty()) continue;
    absl::StrAppend(&help, " Of component ", other.component.value(), " ", other.pairs.size(),
                    " keyframes have a reference pose, too: --component ", other.component.value(), ".");
  }
  std::string why = absl::StrJoin(reasons, "; ");
  if (why.back() != '.' && why.back() != '?') why.push_back('.');
  return absl::FailedPreconditionError(absl::StrFormat("%s does not align component %u; the map is as it was: %s%s",
                                                       request.source, target.component.value(), why, help));
}

// The alignment of a component, if nothing speaks against it.
absl::StatusOr<PoseAlignment> Solve(const std::string& map, const std::vector<AlignmentTarget>& targets,
                                    std::size_t chosen, const std::vector<StampedPose>& reference,
                                    const api::AlignRequest& request) {
  const AlignmentTarget& target = targets[chosen];
  if (target.world_from_component && !request.overwrite) {
    return absl::AlreadyExistsError(
        absl::StrCat("component ", target.component.value(), " of ", map,
                     " is aligned already: ask to overwrite that (--overwrite) to align it anew",
                     targets.size() > 1 ? ", or --component for another one" : ""));
  }
  const std::string have = absl::StrCat(target.keyframes.size(), " keyframes of component ", target.component.value(),
                                        " have a pose within ", request.max_dt_s, " s in ", request.source);
  if (!target.pairs.empty() && target.pairs.size() < kMinPairs && !request.force) {
    return absl::FailedPreconditionError(
        absl::StrCat("only ", target.pairs.size(), " of ", have, "; at least ", kMinPairs,
                     " are needed to tell how far off the alignment may be (--force does without)"));
  }
  const PairedPoses poses = PosesOf(target.keyframes, reference, target.pairs);
  absl::StatusOr<PoseAlignment> found =
      AlignPoses(poses.groundtruth, poses.estimate, std::get<api::ReferencePoses>(request.by).solver);
  if (!found.ok()) return Annotate(found.status(), absl::StrCat(target.pairs.size(), " of ", have));
  CAIRN_RETURN_IF_ERROR(Judge(*found, target, targets, request));
  return found;
}

api::ComponentAlignment Told(const PoseAlignment& found, const AlignmentTarget& target) {
  api::ComponentAlignment told;
  told.component = target.component;
  told.world_from_component = found.a_from_b;
  told.keyframes = static_cast<std::int64_t>(target.keyframes.size());
  told.with_reference = static_cast<std::int64_t>(target.pairs.size());
  told.fitting = found.fit_count;
  for (std::size_t i = 0; i < found.fits.size(); ++i) {
    if (!found.fits[i]) told.misfits_s.push_back(ToSeconds(target.keyframes[target.pairs[i].estimate].time_ns));
  }
  told.rmse_fitting_m = found.rmse_fits;
  told.rmse_all_m = found.rmse_all;
  told.scale_sigma = found.scale_sigma;
  told.rotation_sigma_rad = found.rotation_sigma_rad;
  told.position_sigma_m = found.center_sigma;
  told.noise_position_m = found.sigma_position;
  told.noise_rotation_rad = found.sigma_rotation_rad;
  told.orientations = found.orientations;
  told.orientations_used = found.orientations_used;
  told.camera_in_body_m = found.camera_in_body.norm();
  told.camera_in_body_sigma_m = found.camera_in_body_sigma;
  told.moved_m = MedianMove(target, found.a_from_b);
  return told;
}

}  // namespace

absl::Status CheckScaleAgainst(const Sim3& before, double scale, double relative_sigma) {
  constexpr double kMaxRatio = 1.1, kMaxSigma = 5.0;
  const double ratio = scale / before.scale();
  const double allowed = std::max(std::log(kMaxRatio), kMaxSigma * relative_sigma);
  if (std::abs(std::log(ratio)) <= allowed) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrFormat("it is aligned already at a scale of %.4g, and this reference would make it %.3g times %s",
                      before.scale(), std::max(ratio, 1.0 / ratio), ratio > 1.0 ? "larger" : "smaller"));
}

absl::StatusOr<api::ComponentAlignment> AlignByPoses(const std::string& map, const api::AlignRequest& request,
                                                     map::Edit* edit) {
  const std::vector<StampedPose> reference = SortedFinite(std::get<api::ReferencePoses>(request.by).poses);
  CAIRN_ASSIGN_OR_RETURN(std::vector<AlignmentTarget> targets, TargetsOf(map, edit->base(), request));
  for (AlignmentTarget& target : targets) {
    target.pairs = AssociateNearest(target.keyframes, reference, request.max_dt_s);
  }
  CAIRN_ASSIGN_OR_RETURN(const std::size_t chosen, ChooseTarget(map, targets, request));
  const absl::StatusOr<PoseAlignment> found = Solve(map, targets, chosen, reference, request);
  if (!found.ok() && !request.session) {
    return absl::Status(found.status().code(), absl::StrCat(found.status().message(), HintOfSessions(edit->base())));
  }
  CAIRN_RETURN_IF_ERROR(found.status());
  PutAlignment(targets[chosen].component, found->a_from_b, edit);
  api::ComponentAlignment told = Told(*found, targets[chosen]);
  told.others = OthersOf(targets, chosen);
  return told;
}

}  // namespace cairn::engine

// cairn align: gives a component of a map its place and scale in the world.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "base/median.h"
#include "cli/cli.h"
#include "cli/input_options.h"
#include "engine/live_map.h"
#include "eval/association.h"
#include "eval/reference.h"
#include "geometry/pose_alignment.h"
#include "map/edit.h"

namespace cairn::cli {
namespace {

constexpr double kDegPerRad = 57.29577951308232;

struct AlignOptions {
  std::string map;
  std::string groundtruth;
  eval::ReferenceOptions reference;
  PoseAlignmentOptions solver;
  std::uint32_t component = 0;  // 0: the one with most keyframes that have a reference
  std::uint32_t session = 0;    // whose keyframes the reference is of; 0: of all
  double max_dt_s = 0.02;
  double sigma_rotation_deg = 0.0;
  bool positions_only = false;
  bool force = false;
  bool overwrite = false;
  bool json = false;
};

// A component, and what the reference says about it.
struct Target {
  ComponentId component;
  std::optional<Sim3> world_from_component;  // as it is aligned now
  std::vector<io::StampedPose> keyframes;    // in the order of time
  std::vector<eval::Association> pairs;      // with the reference
};

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

std::vector<Target> FindTargets(const map::Snapshot& map, const std::vector<io::StampedPose>& reference,
                                const AlignOptions& options) {
  std::map<ComponentId, Target> targets;
  for (const ComponentId id : map.LiveComponents()) targets[id] = {id, map.WorldFrom(id), {}, {}};
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (options.session != 0 && keyframe->session != SessionId(options.session)) return;
    targets[keyframe->component].keyframes.push_back({keyframe->time_ns, keyframe->camera_from_map.Inverse()});
  });
  std::vector<Target> found;
  for (auto& [id, target] : targets) {
    target.keyframes = eval::SortedFinite(target.keyframes);
    target.pairs = eval::AssociateNearest(target.keyframes, reference, options.max_dt_s);
    found.push_back(std::move(target));
  }
  return found;
}

absl::StatusOr<std::size_t> ChooseTarget(const std::vector<Target>& targets, const AlignOptions& options) {
  if (targets.empty()) return absl::FailedPreconditionError(absl::StrCat(options.map, " has no keyframes"));
  if (options.component == 0) {
    const auto most = std::max_element(targets.begin(), targets.end(), [](const Target& x, const Target& y) {
      return x.pairs.size() < y.pairs.size();
    });
    return static_cast<std::size_t>(most - targets.begin());
  }
  std::vector<std::uint32_t> there;
  for (std::size_t i = 0; i < targets.size(); ++i) {
    if (targets[i].component.value() == options.component) return i;
    there.push_back(targets[i].component.value());
  }
  return absl::NotFoundError(absl::StrCat(options.map, " has no component ", options.component, "; there is ",
                                          absl::StrJoin(there, ", "), " (cairn info)"));
}

// Scale says whether two alignments can both be right: frames of reference differ in place and rotation, not in size.
absl::Status CheckAgainst(const Sim3& before, const PoseAlignment& found) {
  constexpr double kMaxRatio = 1.1, kMaxSigma = 5.0;
  const double ratio = found.a_from_b.scale() / before.scale();
  const double allowed = std::max(std::log(kMaxRatio), kMaxSigma * found.RelativeScaleSigma());
  if (std::abs(std::log(ratio)) <= allowed) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrFormat("it is aligned already at a scale of %.4g, and this reference would make it %.3g times %s",
                      before.scale(), std::max(ratio, 1.0 / ratio), ratio > 1.0 ? "larger" : "smaller"));
}

// Everything that speaks against an alignment, or OK.
absl::Status Judge(const PoseAlignment& found, const Target& target, const std::vector<Target>& targets,
                   const AlignOptions& options) {
  std::vector<std::string> reasons;
  if (!options.force) {
    if (const absl::Status fits = CheckFits(found); !fits.ok()) reasons.emplace_back(fits.message());
    if (target.world_from_component) {
      const absl::Status same = CheckAgainst(*target.world_from_component, found);
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
  for (const Target& other : targets) {
    if (other.component == target.component || other.pairs.empty()) continue;
    absl::StrAppend(&help, " Of component ", other.component.value(), " ", other.pairs.size(),
                    " keyframes have a reference pose, too: --component ", other.component.value(), ".");
  }
  std::string why = absl::StrJoin(reasons, "; ");
  if (why.back() != '.' && why.back() != '?') why.push_back('.');
  return absl::FailedPreconditionError(absl::StrFormat("%s does not align component %u; the map is as it was: %s%s",
                                                       options.groundtruth, target.component.value(), why, help));
}

// Times of the keyframes whose reference does not fit.
std::vector<double> Misfits(const PoseAlignment& found, const Target& target) {
  std::vector<double> times_s;
  for (std::size_t i = 0; i < found.fits.size(); ++i) {
    if (!found.fits[i]) times_s.push_back(ToSeconds(target.keyframes[target.pairs[i].estimate].time_ns));
  }
  return times_s;
}

// By which the keyframes move in the world, against the alignment there was.
std::optional<double> MedianMove(const PoseAlignment& found, const Target& target) {
  if (!target.world_from_component) return std::nullopt;
  std::vector<double> moves;
  for (const io::StampedPose& keyframe : target.keyframes) {
    const Vector3d& center = keyframe.world_from_camera.translation();
    moves.push_back((found.a_from_b * center - *target.world_from_component * center).norm());
  }
  return Median(std::move(moves));
}

std::string OrientationNote(const PoseAlignment& found, const AlignOptions& options) {
  if (options.positions_only) return "positions alone, as asked for";
  if (found.orientations.kind == OrientationKind::kCamera) return "";
  if (!found.orientations_used) {
    return absl::StrCat(eval::Describe(found.orientations), ": aligned by positions alone");
  }
  return absl::StrFormat("%s; the camera sits %.3f +- %.3f m from its centre", eval::Describe(found.orientations),
                         found.camera_in_body.norm(), found.camera_in_body_sigma);
}

struct Outcome {
  const AlignOptions& options;
  const eval::Reference& reference;
  const std::vector<Target>& targets;
  const Target& target;
  const PoseAlignment& found;
  Revision revision;
};

void PrintOutcomeJson(const Outcome& o) {
  const PoseAlignment& found = o.found;
  nlohmann::ordered_json others = nlohmann::ordered_json::array();
  for (const Target& other : o.targets) {
    if (other.component == o.target.component) continue;
    others.push_back({{"component", other.component.value()},
                      {"keyframes", other.keyframes.size()},
                      {"with_reference", other.pairs.size()},
                      {"aligned", other.world_from_component.has_value()}});
  }
  nlohmann::ordered_json json = {{"frame", "world"},
                                 {"unit", "m"},
                                 {"map", o.options.map},
                                 {"revision", o.revision},
                                 {"component", o.target.component.value()},
                                 {"components", o.targets.size()},
                                 {"keyframes", o.target.keyframes.size()},
                                 {"keyframes_used", o.target.pairs.size()},
                                 {"inliers", found.fit_count},
                                 {"misfits_s", Misfits(found, o.target)},
                                 {"rmse_m", found.rmse_fits},
                                 {"rmse_all_m", found.rmse_all},
                                 {"scale", found.a_from_b.scale()},
                                 {"scale_sigma", found.scale_sigma},
                                 {"rotation_sigma_deg", found.rotation_sigma_rad * kDegPerRad},
                                 {"position_sigma_m", found.center_sigma},
                                 {"noise_position_m", found.sigma_position},
                                 {"noise_rotation_deg", nullptr},
                                 {"orientations", eval::NameOf(found.orientations.kind)},
                                 {"body_turned_deg", nullptr},
                                 {"body_distance_m", nullptr},
                                 {"sensor", nullptr},
                                 {"moved_m", nullptr},
                                 {"other_components", others}};
  if (found.orientations_used) json["noise_rotation_deg"] = found.sigma_rotation_rad * kDegPerRad;
  if (found.orientations_used && found.orientations.kind == OrientationKind::kBody) {
    json["body_turned_deg"] = AngleRad(found.orientations.camera_from_body) * kDegPerRad;
    json["body_distance_m"] = found.camera_in_body.norm();
  }
  if (o.reference.body_from_camera) json["sensor"] = o.reference.sensor;
  if (const auto moved_m = MedianMove(found, o.target)) json["moved_m"] = *moved_m;
  PrintJson(json);
}

void PrintOutcome(const Outcome& o) {
  const PoseAlignment& found = o.found;
  std::printf("%s, component %u, is aligned: scale %.4f +- %.4f, rotation +- %.2f deg, position +- %.4f m\n",
              o.options.map.c_str(), o.target.component.value(), found.a_from_b.scale(), found.scale_sigma,
              found.rotation_sigma_rad * kDegPerRad, found.center_sigma);
  std::printf("  %d of its %zu keyframes with a reference pose fit: %.4f m RMSE (all %zu: %.4f m)\n", found.fit_count,
              o.target.pairs.size(), found.rmse_fits, o.target.pairs.size(), found.rmse_all);
  const std::vector<double> misfits = Misfits(found, o.target);
  if (!misfits.empty()) {
    constexpr std::size_t kFirst = 5;
    std::vector<std::string> first;
    for (std::size_t i = 0; i < std::min(misfits.size(), kFirst); ++i) {
      first.push_back(absl::StrFormat("%.3f", misfits[i]));
    }
    std::printf("  %zu do not fit, at %s s%s\n", misfits.size(), absl::StrJoin(first, ", ").c_str(),
                misfits.size() > kFirst ? ", ..." : "");
  }
  for (const std::string& note : {eval::Describe(o.reference), OrientationNote(found, o.options)}) {
    if (!note.empty()) std::printf("  %s\n", note.c_str());
  }
  if (const auto moved_m = MedianMove(found, o.target)) {
    std::printf("  its keyframes moved by %.4f m (median) from the alignment that it had\n", *moved_m);
  }
  for (const Target& other : o.targets) {
    if (other.component == o.target.component) continue;
    std::printf("  component %u, %zu keyframes, %zu with a reference pose, remains %s\n", other.component.value(),
                other.keyframes.size(), other.pairs.size(),
                other.world_from_component ? "aligned as it was" : "without alignment");
  }
}

// Fewer residuals do not show their own spread: the error is many times what they claim.
constexpr std::size_t kMinPairs = 7;

absl::Status Store(engine::LiveMap::Editor& editor, ComponentId id, const Sim3& world_from_component) {
  map::Edit edit(editor.View()->snapshot());
  map::Component component = edit.component(id);
  component.world_from_component = world_from_component;
  edit.PutComponent(component);
  return editor.Commit(edit.Finish(absl::StrCat("align component ", id.value(), " to the world")), {});
}

// The alignment of a component, if nothing speaks against it.
absl::StatusOr<PoseAlignment> Solve(const std::vector<Target>& targets, std::size_t chosen,
                                    const std::vector<io::StampedPose>& reference, const AlignOptions& options) {
  const Target& target = targets[chosen];
  if (target.world_from_component && !options.overwrite) {
    return absl::AlreadyExistsError(absl::StrCat("component ", target.component.value(), " of ", options.map,
                                                 " is aligned already: give --overwrite to align it anew",
                                                 targets.size() > 1 ? ", or --component for another one" : ""));
  }
  if (!target.pairs.empty() && target.pairs.size() < kMinPairs && !options.force) {
    return absl::FailedPreconditionError(absl::StrCat(
        "only ", target.pairs.size(), " of ", target.keyframes.size(), " keyframes of component ",
        target.component.value(), " have a pose within ", options.max_dt_s, " s in ", options.groundtruth,
        "; at least ", kMinPairs, " are needed to tell how far off the alignment may be (--force does without)"));
  }
  const eval::PairedPoses poses = eval::PosesOf(target.keyframes, reference, target.pairs);
  absl::StatusOr<PoseAlignment> found = AlignPoses(poses.groundtruth, poses.estimate, options.solver);
  if (!found.ok()) {
    return Annotate(found.status(),
                    absl::StrCat(target.pairs.size(), " of ", target.keyframes.size(), " keyframes of component ",
                                 target.component.value(), " have a pose within ", options.max_dt_s, " s in ",
                                 options.groundtruth));
  }
  CAIRN_RETURN_IF_ERROR(Judge(*found, target, targets, options));
  return found;
}

absl::Status Align(AlignOptions options) {
  options.solver.sigma_rotation_rad = options.sigma_rotation_deg / kDegPerRad;
  options.solver.use_orientations = !options.positions_only;
  CAIRN_ASSIGN_OR_RETURN(const eval::Reference given, eval::LoadReference(options.groundtruth, options.reference));
  TellNotes("align", given.trajectory.notes);
  const std::vector<io::StampedPose> reference = eval::SortedFinite(given.trajectory.poses);
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<engine::LiveMap> live, engine::LiveMap::Open(options.map));
  std::vector<Target> targets;
  std::size_t chosen = 0;
  absl::StatusOr<PoseAlignment> found = absl::InternalError("not computed");
  {
    // Nobody else changes the map between what is computed and what is stored.
    engine::LiveMap::Editor editor = live->BeginEdit();
    const std::shared_ptr<const tracking::MapView> view = editor.View();
    const map::Snapshot& map = view->map();
    if (options.session != 0 && !map.sessions().contains(SessionId(options.session))) {
      return absl::NotFoundError(absl::StrCat(options.map, " has no session ", options.session, " (cairn info)"));
    }
    targets = FindTargets(map, reference, options);
    CAIRN_ASSIGN_OR_RETURN(chosen, ChooseTarget(targets, options));
    found = Solve(targets, chosen, reference, options);
    if (!found.ok() && options.session == 0) {
      return absl::Status(found.status().code(), absl::StrCat(found.status().message(), HintOfSessions(map)));
    }
    CAIRN_RETURN_IF_ERROR(found.status());
    CAIRN_RETURN_IF_ERROR(Store(editor, targets[chosen].component, found->a_from_b));
  }
  CAIRN_RETURN_IF_ERROR(live->Close());
  const Outcome outcome{options, given, targets, targets[chosen], *found, live->Published()->revision()};
  if (options.json) {
    PrintOutcomeJson(outcome);
  } else {
    PrintOutcome(outcome);
  }
  return absl::OkStatus();
}

void AddOptions(CLI::App* verb, const std::shared_ptr<AlignOptions>& options) {
  verb->add_option("MAP", options->map, "Map file (.cairn); stores the component's similarity to the world in it")
      ->required();
  verb->add_option("--groundtruth", options->groundtruth,
                   "Camera poses of the mapped sequence: TUM, EuRoC csv or KITTI")
      ->required();
  verb->add_option("--component", options->component,
                   "Component to align; by default the one with most keyframes that have a reference pose")
      ->check(CLI::PositiveNumber);
  verb->add_option("--session", options->session,
                   "Session whose poses these are; by default every keyframe that has a pose at its time counts")
      ->check(CLI::PositiveNumber);
  verb->add_option("--sensor", options->reference.sensor,
                   "File with T_BS, where the camera sits on the body that the poses are of (EuRoC's sensor.yaml); by "
                   "default the one of cam0 beside an EuRoC csv; none: poses as they are");
  verb->add_option("--max-dt", options->max_dt_s, "Largest time difference of keyframe and reference, seconds")
      ->capture_default_str();
  verb->add_flag("--positions-only", options->positions_only, "Do not use the orientations of the reference");
  verb->add_option("--sigma-position", options->solver.sigma_position,
                   "Noise of the positions per axis, metres; estimated if not given")
      ->check(CLI::PositiveNumber);
  verb->add_option("--sigma-rotation", options->sigma_rotation_deg,
                   "Noise of the orientations per axis, degrees; estimated if not given")
      ->check(CLI::PositiveNumber);
  verb->add_flag("--overwrite", options->overwrite, "Replace an alignment that the component has");
  verb->add_flag("--force", options->force,
                 "Align although many poses do not fit, few keyframes have one, or the scale is not that of the "
                 "alignment there is");
  verb->add_flag("--json", options->json, "Answer in JSON");
}

}  // namespace

void AddAlignCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("align", "Give a map its scale and place in the world, from known camera poses");
  auto options = std::make_shared<AlignOptions>();
  AddOptions(verb, options);
  verb->footer(
      "Examples:\n  cairn align office.cairn --groundtruth groundtruth.txt\n"
      "  cairn align office.cairn --component 2 --groundtruth state_groundtruth_estimate0/data.csv --sensor "
      "cam0/sensor.yaml\n"
      "  cairn align track.cairn --groundtruth gps.txt --positions-only");
  verb->callback([=] {
    *action = [=] {
      const absl::Status status = Align(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("align", status, options->json);
    };
  });
}

}  // namespace cairn::cli

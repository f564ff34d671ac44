// cairn eval ate|rpe|loop|localization: trajectories and answers against ground truth.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <limits>

#include "absl/strings/str_format.h"
#include "base/angles.h"
#include "cli/cli.h"
#include "cli/input_options.h"
#include "cli/pictures.h"
#include "eval/ate.h"
#include "eval/localization.h"
#include "eval/loop.h"
#include "eval/reference.h"
#include "eval/rpe.h"
#include "io/trajectory.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct EvalOptions {
  std::string estimate;
  std::string groundtruth;
  std::string plot;
  std::string queries;
  std::string unit = "m";
  eval::AteOptions ate;
  eval::RpeOptions rpe;
  eval::LoopOptions loop;
  eval::LocalizationOptions localization;
  eval::ReferenceOptions reference;
  bool rigid = false;
  bool no_align = false;
  bool overwrite = false;
  bool json = false;
};

// Poses that count frames cannot be paired with poses that have times.
absl::StatusOr<io::Trajectory> ReadEstimate(const std::string& verb, const std::string& path,
                                            const io::Trajectory& truth, bool may_be_empty = false) {
  CAIRN_ASSIGN_OR_RETURN(io::Trajectory estimate, io::ReadTrajectory(path, may_be_empty));
  TellNotes(verb, estimate.notes);
  if (!estimate.poses.empty() && estimate.counts_frames != truth.counts_frames) {
    return absl::InvalidArgumentError(
        absl::StrCat("the times of one file are whole numbers one apart, as if they counted frames, those of the other "
                     "are not, so that they cannot be paired: ",
                     estimate.counts_frames ? path : "the reference", " needs times of the same clock"));
  }
  return estimate;
}

absl::StatusOr<eval::Reference> ReadReference(const std::string& verb, const EvalOptions& options) {
  absl::StatusOr<eval::Reference> reference = eval::LoadReference(options.groundtruth, options.reference);
  if (reference.ok()) TellNotes(verb, reference->trajectory.notes);
  return reference;
}

bool IsFolder(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::is_directory(path, ignored);
}

// The estimate's files: itself, or every file of a folder of runs, in the order of names.
absl::StatusOr<std::vector<std::string>> EstimateFiles(const std::string& path) {
  if (!IsFolder(path)) return std::vector<std::string>{path};
  std::vector<std::string> files;
  std::error_code error, ignored;
  for (auto it = std::filesystem::directory_iterator(path, error);
       !error && it != std::filesystem::directory_iterator(); it.increment(error)) {
    if (it->is_regular_file(ignored)) files.push_back(it->path().string());
  }
  if (error) return absl::UnavailableError(absl::StrCat("cannot read the folder ", path, ": ", error.message()));
  std::sort(files.begin(), files.end());
  if (files.empty()) return absl::NotFoundError(absl::StrCat("no trajectory file in the folder ", path));
  return files;
}

// Evaluates every run with `evaluate` and prints the figure of each and their median. A run that cannot be evaluated
// counts as `failed_value`, as in the paper's protocol.
template <class Evaluate>
int EvaluateRuns(const EvalOptions& options, const io::Trajectory& truth, const char* verb, const char* figure,
                 double failed_value, const Evaluate& evaluate) {
  const auto files = EstimateFiles(options.estimate);
  if (!files.ok()) return Fail(verb, files.status(), options.json);
  std::vector<absl::StatusOr<double>> values;
  nlohmann::ordered_json runs = nlohmann::ordered_json::array();
  for (const std::string& file : *files) {
    const auto estimate = ReadEstimate(verb, file, truth);
    values.push_back(estimate.ok() ? evaluate(*estimate) : absl::StatusOr<double>(estimate.status()));
    const absl::StatusOr<double>& value = values.back();
    const std::string name = std::filesystem::path(file).filename().string();
    runs.push_back({{"run", name}});
    if (value.ok()) {
      runs.back()[figure] = *value;
    } else {
      runs.back()["failed"] = std::string(value.status().message());
    }
    if (!options.json) {
      if (value.ok())
        std::printf("%-24s %s %.4f\n", name.c_str(), figure, *value);
      else
        std::printf("%-24s failed: %s\n", name.c_str(), std::string(value.status().message()).c_str());
    }
  }
  const eval::RunSummary summary = eval::SummarizeRuns(values, failed_value);
  if (options.json) {
    PrintJson({{"frame", "world"},
               {"unit", "m"},
               {"runs", runs},
               {"failed", summary.failed},
               {"median", summary.median},
               {"best", summary.best},
               {"worst", summary.worst}});
  } else {
    text::Say(absl::StrFormat("median of %d runs: %.4f m (best %.4f, worst %.4f, %d failed)\n", summary.runs,
                              summary.median, summary.best, summary.worst, summary.failed));
  }
  return summary.failed == summary.runs ? kFailure : kOk;
}

nlohmann::ordered_json ToJson(const eval::Statistics& s, double unit = 1.0) {
  return {{"rmse", s.rmse * unit},   {"mean", s.mean * unit}, {"median", s.median * unit},
          {"std", s.std_dev * unit}, {"min", s.min * unit},   {"max", s.max * unit}};
}

// What was done to the reference and what its orientations are, so that nobody takes a body's poses for a camera's.
nlohmann::ordered_json ToJson(const eval::Reference& reference, const OrientationAgreement& orientations) {
  nlohmann::ordered_json json = {{"sensor", nullptr}, {"orientations", eval::NameOf(orientations.kind)}};
  if (reference.body_from_camera) json["sensor"] = reference.sensor;
  if (orientations.kind == OrientationKind::kBody) {
    json["body_turned_deg"] = AngleRad(orientations.camera_from_body) * kDegPerRad;
  }
  return json;
}

void PrintNotes(const eval::Reference& reference, const OrientationAgreement& orientations) {
  for (const std::string& note : {eval::Describe(reference), eval::Describe(orientations)}) {
    if (!note.empty()) text::Say(absl::StrFormat("  %s\n", text::Shown(note)));
  }
}

// Null where orientations mean nothing.
nlohmann::ordered_json RotationJson(const eval::Statistics& rotation_rad) {
  if (rotation_rad.count == 0) return nullptr;
  return ToJson(rotation_rad, kDegPerRad);
}

std::string RotationText(const eval::Statistics& rotation_rad, double value_rad, const char* format) {
  if (rotation_rad.count == 0) return "not known";
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), format, value_rad * kDegPerRad);
  return text.data();
}

int RunAte(EvalOptions options) {
  constexpr const char* kVerb = "eval ate";
  options.ate.with_scale = !options.rigid;
  options.ate.align = !options.no_align;
  absl::Status writable = CheckWritable(options.plot, options.overwrite);
  writable.Update(CheckDistinct({options.plot}, {options.estimate, options.groundtruth, options.reference.sensor}));
  writable.Update(CheckPicture(options.plot));
  if (!writable.ok()) return Fail(kVerb, writable, options.json);
  const auto reference = ReadReference(kVerb, options);
  if (!reference.ok()) return Fail(kVerb, reference.status(), options.json);
  const std::vector<io::StampedPose>& truth = reference->trajectory.poses;
  if (IsFolder(options.estimate)) {
    constexpr double kFailedRun_m = 10.0;
    return EvaluateRuns(options, reference->trajectory, kVerb, "ate_m", kFailedRun_m,
                        [&](const io::Trajectory& estimate) -> absl::StatusOr<double> {
                          CAIRN_ASSIGN_OR_RETURN(const eval::AteResult run,
                                                 eval::EvaluateAte(estimate.poses, truth, options.ate));
                          return run.position_m.rmse;
                        });
  }
  const auto estimate = ReadEstimate(kVerb, options.estimate, reference->trajectory);
  if (!estimate.ok()) return Fail(kVerb, estimate.status(), options.json);
  const auto result = eval::EvaluateAte(estimate->poses, truth, options.ate);
  if (!result.ok()) return Fail(kVerb, result.status(), options.json);
  if (!options.plot.empty()) {
    const std::string title = std::filesystem::path(options.estimate).filename().string();
    if (absl::Status status = DrawAte(*result, truth, title, options.plot); !status.ok())
      return Fail(kVerb, status, options.json);
  }
  if (options.json) {
    PrintJson({{"frame", "world"},
               {"unit", "m"},
               {"ate_m", result->position_m.rmse},
               {"position_m", ToJson(result->position_m)},
               {"rotation_deg", RotationJson(result->rotation_rad)},
               {"scale", result->groundtruth_from_estimate.scale()},
               {"poses", result->estimated},
               {"associated", result->position_m.count},
               {"path_m", result->path_length_m},
               {"reference", ToJson(*reference, result->orientations)}});
    return kOk;
  }
  text::Say(absl::StrFormat("ATE %.4f m RMSE over %d poses (%d without ground truth)\n", result->position_m.rmse,
                            result->position_m.count, result->estimated - result->position_m.count));
  text::Say(absl::StrFormat("  median %.4f m, max %.4f m, rotation median %s, scale %.4f, path %.2f m\n",
                            result->position_m.median, result->position_m.max,
                            RotationText(result->rotation_rad, result->rotation_rad.median, "%.2f deg"),
                            result->groundtruth_from_estimate.scale(), result->path_length_m));
  PrintNotes(*reference, result->orientations);
  if (!options.plot.empty()) text::Say(absl::StrFormat("  picture: %s\n", text::Shown(options.plot)));
  return kOk;
}

int RunRpe(EvalOptions options) {
  constexpr const char* kVerb = "eval rpe";
  options.rpe.with_scale = !options.rigid;
  options.rpe.unit = options.unit == "frames" ? eval::RpeUnit::kFrames
                     : options.unit == "s"    ? eval::RpeUnit::kSeconds
                                              : eval::RpeUnit::kMeters;
  const auto reference = ReadReference(kVerb, options);
  if (!reference.ok()) return Fail(kVerb, reference.status(), options.json);
  const std::vector<io::StampedPose>& truth = reference->trajectory.poses;
  const auto estimate = ReadEstimate(kVerb, options.estimate, reference->trajectory);
  if (!estimate.ok()) return Fail(kVerb, estimate.status(), options.json);
  const auto results = eval::EvaluateRpe(estimate->poses, truth, options.rpe);
  if (!results.ok()) return Fail(kVerb, results.status(), options.json);
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const eval::RpeResult& result : results->per_delta) {
    list.push_back({{"delta", result.delta},
                    {"unit", options.unit},
                    {"segments", result.segments},
                    {"translation_m", ToJson(result.translation_m)},
                    {"rotation_deg", RotationJson(result.rotation_rad)},
                    {"drift_percent", result.drift_percent}});
    if (!options.json) {
      text::Say(absl::StrFormat("over %g %s: %.4f m RMSE, rotation %s, drift %.2f %% (%d segments)\n", result.delta,
                                options.unit, result.translation_m.rmse,
                                RotationText(result.rotation_rad, result.rotation_rad.rmse, "%.3f deg RMSE"),
                                result.drift_percent, result.segments));
    }
  }
  if (options.json) {
    PrintJson(
        {{"frame", "camera"}, {"unit", "m"}, {"rpe", list}, {"reference", ToJson(*reference, results->orientations)}});
  } else {
    PrintNotes(*reference, results->orientations);
  }
  return kOk;
}

int RunLoop(const EvalOptions& options) {
  constexpr const char* kVerb = "eval loop";
  const auto truth = io::ReadTrajectory(options.groundtruth);
  if (!truth.ok()) return Fail(kVerb, truth.status(), options.json);
  TellNotes(kVerb, truth->notes);
  if (IsFolder(options.estimate)) {
    return EvaluateRuns(options, *truth, kVerb, "e_align_m", std::numeric_limits<double>::infinity(),
                        [&](const io::Trajectory& estimate) -> absl::StatusOr<double> {
                          CAIRN_ASSIGN_OR_RETURN(const eval::LoopResult run,
                                                 eval::EvaluateLoop(estimate.poses, *truth, options.loop));
                          return run.align_error_m;
                        });
  }
  const auto estimate = ReadEstimate(kVerb, options.estimate, *truth);
  if (!estimate.ok()) return Fail(kVerb, estimate.status(), options.json);
  const auto result = eval::EvaluateLoop(estimate->poses, *truth, options.loop);
  if (!result.ok()) return Fail(kVerb, result.status(), options.json);
  if (options.json) {
    PrintJson({{"frame", "world"},
               {"unit", "m"},
               {"e_align_m", result->align_error_m},
               {"start_rmse_m", result->start_rmse_m},
               {"end_rmse_m", result->end_rmse_m},
               {"rotation_drift_deg", result->rotation_drift_rad * kDegPerRad},
               {"scale_drift", result->scale_drift},
               {"start_poses", result->start_poses},
               {"end_poses", result->end_poses}});
  } else {
    text::Say(absl::StrFormat(
        "e_align %.4f m; rotation drift %.2f deg, scale drift %.4f (%d poses at the start, %d at the end)\n",
        result->align_error_m, result->rotation_drift_rad * kDegPerRad, result->scale_drift, result->start_poses,
        result->end_poses));
  }
  return kOk;
}

int RunLocalization(const EvalOptions& options) {
  constexpr const char* kVerb = "eval localization";
  const auto reference = ReadReference(kVerb, options);
  if (!reference.ok()) return Fail(kVerb, reference.status(), options.json);
  // A list of queries says who was asked: no pose at all is then an answer, too.
  const auto poses =
      ReadEstimate(kVerb, options.estimate, reference->trajectory, /*may_be_empty=*/!options.queries.empty());
  if (!poses.ok()) return Fail(kVerb, poses.status(), options.json);
  std::vector<eval::LocalizationAnswer> answers;
  for (const io::StampedPose& pose : poses->poses) answers.push_back({pose.time_ns, pose.world_from_camera});
  std::optional<std::vector<TimeNs>> only;
  if (!options.queries.empty()) {
    const auto times = eval::ReadTimesFile(options.queries);
    if (!times.ok()) return Fail(kVerb, times.status(), options.json);
    only = *times;
    // Whoever was asked and has no pose in the file was not located.
    const TimeNs tolerance_ns = FromSeconds(options.localization.max_dt_s);
    const std::size_t located = answers.size();
    for (const TimeNs time_ns : *times) {
      const bool answered =
          std::any_of(answers.begin(), answers.begin() + static_cast<std::ptrdiff_t>(located),
                      [&](const auto& answer) { return std::abs(answer.time_ns - time_ns) <= tolerance_ns; });
      if (!answered) answers.push_back({time_ns, std::nullopt});
    }
  }
  const auto result = eval::EvaluateLocalization(answers, reference->trajectory.poses, only, options.localization);
  if (!result.ok()) return Fail(kVerb, result.status(), options.json);
  const double wrong_of_answered = result->answered > 0 ? static_cast<double>(result->wrong) / result->answered : 0.0;
  if (options.json) {
    PrintJson(
        {{"frame", "world"},
         {"unit", "m"},
         {"queries", result->queries},
         {"answered", result->answered},
         {"within", result->within},
         {"wrong", result->wrong},
         {"within_share", result->within_share},
         {"wrong_share_of_answered", wrong_of_answered},
         {"without_reference", result->without_reference},
         {"error_m", ToJson(result->error_m)},
         {"error_deg", result->answered == 0 ? ToJson(result->error_rad, kDegPerRad) : RotationJson(result->error_rad)},
         {"reference", ToJson(*reference, result->orientations)}});
  } else {
    text::Say(absl::StrFormat(
        "%d queries, %d answered; %.1f %% within %g m / %g deg; %.1f %% of the answers worse than %g m / %g deg\n",
        result->queries, result->answered, 100.0 * result->within_share, options.localization.within_m,
        options.localization.within_deg, 100.0 * wrong_of_answered, options.localization.wrong_m,
        options.localization.wrong_deg));
    text::Say(absl::StrFormat("  median error %.4f m, %s (%d answers have no reference pose)\n", result->error_m.median,
                              RotationText(result->error_rad, result->error_rad.median, "%.2f deg"),
                              result->without_reference));
    PrintNotes(*reference, result->orientations);
  }
  return kOk;
}

CLI::App* AddVerb(CLI::App* parent, const char* name, const char* about, const char* estimate_help,
                  const std::shared_ptr<EvalOptions>& options) {
  CLI::App* verb = parent->add_subcommand(name, about);
  verb->add_option("ESTIMATE", options->estimate, estimate_help)->required();
  verb->add_option("GROUNDTRUTH", options->groundtruth, "TUM trajectory, EuRoC csv or KITTI poses.txt")->required();
  verb->add_flag("--json", options->json, "Answer in JSON");
  return verb;
}

void AddSensorOption(CLI::App* verb, const std::shared_ptr<EvalOptions>& options) {
  verb->add_option(
      "--sensor", options->reference.sensor,
      "File with T_BS, where the camera sits on the body that the ground truth is of (EuRoC's sensor.yaml); "
      "by default the one of cam0 beside an EuRoC csv; none: take the poses as they are");
}

}  // namespace

void AddEvalCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("eval", "Measure trajectories and localization against ground truth");
  verb->require_subcommand(1);
  auto options = std::make_shared<EvalOptions>();
  const char* runs_help = "Trajectory file, or a folder of several runs (then their median is reported)";

  CLI::App* ate = AddVerb(verb, "ate", "Absolute trajectory error after Sim(3) alignment", runs_help, options);
  ate->add_option("--max-dt", options->ate.max_dt_s, "Largest time difference to the ground truth, seconds")
      ->capture_default_str();
  ate->add_flag("--rigid", options->rigid, "Align without scale");
  ate->add_flag("--no-align", options->no_align, "Do not align: the trajectory is in the ground truth's frame already");
  AddSensorOption(ate, options);
  ate->add_option("--plot", options->plot, "Draw both trajectories to this .png or .svg file");
  ate->add_flag("--overwrite", options->overwrite, "Replace the picture if it exists");
  ate->footer("Example:\n  cairn eval ate frames.txt groundtruth.txt --plot ate.png");
  ate->callback([=] { *action = [=] { return RunAte(*options); }; });

  CLI::App* rpe = AddVerb(verb, "rpe", "Relative pose error over given distances: drift", "Trajectory file", options);
  rpe->add_option("--delta", options->rpe.deltas, "Lengths of the segments")->capture_default_str();
  rpe->add_option("--unit", options->unit, "Of the lengths")
      ->check(CLI::IsMember({"m", "s", "frames"}))
      ->capture_default_str();
  rpe->add_option("--max-dt", options->rpe.max_dt_s, "Largest time difference to the ground truth, seconds")
      ->capture_default_str();
  AddSensorOption(rpe, options);
  rpe->add_flag("--rigid", options->rigid, "Take the estimate's scale as it is");
  rpe->footer("Example:\n  cairn eval rpe frames.txt groundtruth.txt --delta 1 5 10");
  rpe->callback([=] { *action = [=] { return RunRpe(*options); }; });

  CLI::App* loop = AddVerb(verb, "loop", "Drift from start to end by the TUM monoVO protocol", runs_help, options);
  loop->add_option("--max-dt", options->loop.max_dt_s, "Largest time difference to the ground truth, seconds")
      ->capture_default_str();
  loop->footer("Example:\n  cairn eval loop keyframes.txt groundtruthSync.txt");
  loop->callback([=] { *action = [=] { return RunLoop(*options); }; });

  CLI::App* localization = AddVerb(verb, "localization", "Answers of `cairn localize` against reference poses",
                                   "Poses written by `cairn localize --out`", options);
  localization->add_option("--queries", options->queries,
                           "File of query times: counts those only, and what is missing as a miss");
  AddSensorOption(localization, options);
  localization->add_option("--within-m", options->localization.within_m, "A good answer is nearer than this")
      ->capture_default_str();
  localization->add_option("--within-deg", options->localization.within_deg, "and turned by less than this")
      ->capture_default_str();
  localization->add_option("--wrong-m", options->localization.wrong_m, "A wrong answer is further than this")
      ->capture_default_str();
  localization->add_option("--wrong-deg", options->localization.wrong_deg, "or turned by more than this")
      ->capture_default_str();
  localization
      ->add_option("--max-dt", options->localization.max_dt_s, "Largest time difference to the reference, seconds")
      ->capture_default_str();
  localization->footer("Example:\n  cairn eval localization poses.txt groundtruth.txt --queries covered.txt");
  localization->callback([=] { *action = [=] { return RunLocalization(*options); }; });
}

}  // namespace cairn::cli

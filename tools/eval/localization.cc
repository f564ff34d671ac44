#include "eval/localization.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "absl/strings/ascii.h"
#include "absl/strings/str_split.h"
#include "eval/reference.h"
#include "geometry/pose_association.h"
#include "io/atomic_file.h"
#include "io/time_text.h"

namespace cairn::eval {

absl::Status LocalizationOptions::Validate() const {
  for (const double value : {within_m, within_deg, wrong_m, wrong_deg, max_dt_s}) {
    if (!(value >= 0.0) || !std::isfinite(value)) {
      return absl::InvalidArgumentError(absl::StrCat("localization limits must not be negative, got ", value));
    }
  }
  if (within_m > wrong_m || within_deg > wrong_deg) {
    return absl::InvalidArgumentError("an answer cannot be good and wrong: within_m/_deg exceeds wrong_m/_deg");
  }
  return absl::OkStatus();
}

namespace {

bool HasTime(const std::vector<TimeNs>& sorted, TimeNs time_ns, TimeNs max_dt_ns) {
  const auto at = std::lower_bound(sorted.begin(), sorted.end(), time_ns - max_dt_ns);
  return at != sorted.end() && *at <= time_ns + max_dt_ns;
}

// Of the answers that have a reference, in the order of time.
OrientationAgreement OrientationsOf(std::span<const LocalizationAnswer> answers, std::span<const io::StampedPose> truth,
                                    double max_dt_s) {
  std::vector<io::StampedPose> located;
  for (const LocalizationAnswer& answer : answers) {
    if (answer.world_from_camera) located.push_back({answer.time_ns, *answer.world_from_camera});
  }
  located = SortedFinite(located);
  const PairedPoses poses = PosesOf(located, truth, AssociateNearest(located, truth, max_dt_s));
  return OrientationsInOneFrame(poses.groundtruth, poses.estimate);
}

}  // namespace

absl::StatusOr<LocalizationResult> EvaluateLocalization(std::span<const LocalizationAnswer> answers,
                                                        std::span<const io::StampedPose> reference,
                                                        const std::optional<std::vector<TimeNs>>& only_times_ns,
                                                        const LocalizationOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  std::vector<TimeNs> times = only_times_ns.value_or(std::vector<TimeNs>{});
  std::sort(times.begin(), times.end());
  const std::vector<io::StampedPose> truth = SortedFinite(reference);
  const TimeNs max_dt_ns = FromSeconds(options.max_dt_s);

  LocalizationResult result;
  result.orientations = OrientationsOf(answers, truth, options.max_dt_s);
  const bool turned = result.orientations.kind != OrientationKind::kConstant;
  std::vector<double> errors_m, errors_rad;
  for (const LocalizationAnswer& answer : answers) {
    if (only_times_ns.has_value() && !HasTime(times, answer.time_ns, max_dt_ns)) continue;
    const io::StampedPose asked{.time_ns = answer.time_ns, .world_from_camera = SE3()};
    const auto match = AssociateNearest({&asked, 1}, truth, options.max_dt_s);
    if (match.empty()) {
      ++result.without_reference;
      continue;
    }
    ++result.queries;
    LocalizationQuery query{.time_ns = answer.time_ns};
    if (answer.world_from_camera.has_value()) {
      const SE3 expected =
          WithMount(truth[match[0].groundtruth].world_from_camera, result.orientations.camera_from_body);
      query.error_m = (answer.world_from_camera->translation() - expected.translation()).norm();
      if (turned) query.error_rad = AngleRad(answer.world_from_camera->rotation().conjugate() * expected.rotation());
      const double error_deg = query.error_rad * 180.0 / std::numbers::pi;
      query.verdict = LocalizationVerdict::kInaccurate;
      // Written so that an answer that is not a number is wrong.
      if (query.error_m <= options.within_m && error_deg <= options.within_deg) {
        query.verdict = LocalizationVerdict::kGood;
        ++result.within;
      } else if (!(query.error_m <= options.wrong_m && error_deg <= options.wrong_deg)) {
        query.verdict = LocalizationVerdict::kWrong;
        ++result.wrong;
      }
      ++result.answered;
      errors_m.push_back(query.error_m);
      if (turned) errors_rad.push_back(query.error_rad);
    }
    result.per_query.push_back(query);
  }
  if (result.queries == 0) {
    return absl::FailedPreconditionError(
        absl::StrCat("none of ", answers.size(), " queries has a reference pose within ", options.max_dt_s, " s"));
  }
  result.within_share = static_cast<double>(result.within) / result.queries;
  result.wrong_share = static_cast<double>(result.wrong) / result.queries;
  result.error_m = Summarize(errors_m);
  result.error_rad = Summarize(errors_rad);
  return result;
}

absl::StatusOr<std::vector<TimeNs>> ReadTimesFile(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const std::string text, io::ReadWholeFile(path));
  std::vector<TimeNs> times;
  int number = 0;
  for (absl::string_view line : absl::StrSplit(text, '\n')) {
    ++number;
    line = absl::StripAsciiWhitespace(line);
    if (line.empty() || line[0] == '#') continue;
    const std::vector<absl::string_view> fields = absl::StrSplit(line, absl::ByAnyChar(" ,\t"), absl::SkipEmpty());
    if (fields.empty()) continue;
    auto time = io::ParseSeconds(fields[0]);
    if (!time.ok()) return Annotate(time.status(), absl::StrCat(path, ", line ", number));
    times.push_back(*time);
  }
  return times;
}

}  // namespace cairn::eval

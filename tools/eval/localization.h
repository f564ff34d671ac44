// How well "where is this camera?" was answered: each query's answer against a reference pose, in the reference's frame
// (the map is aligned to it beforehand; nothing is aligned here).
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "eval/statistics.h"
#include "geometry/orientation_agreement.h"
#include "geometry/se3.h"
#include "io/trajectory.h"

namespace cairn::eval {

struct LocalizationAnswer {
  TimeNs time_ns = 0;
  std::optional<SE3> world_from_camera;  // nothing: not localized
};

struct LocalizationOptions {
  // Good: closer than both. Wrong: further than either.
  double within_m = 0.05;
  double within_deg = 3.0;
  double wrong_m = 0.2;
  double wrong_deg = 10.0;
  // A query's reference (and its entry in a list of times) is the nearest within this.
  double max_dt_s = 0.005;

  absl::Status Validate() const;
};

enum class LocalizationVerdict { kMiss, kGood, kInaccurate, kWrong };

struct LocalizationQuery {
  TimeNs time_ns = 0;
  LocalizationVerdict verdict = LocalizationVerdict::kMiss;
  double error_m = 0.0;  // 0 for a miss
  double error_rad = 0.0;
};

struct LocalizationResult {
  int queries = 0;   // with a reference pose and, if times were given, among them
  int answered = 0;  // not missed
  int within = 0;    // good
  int wrong = 0;
  int without_reference = 0;  // left out
  // Of all queries counted, in [0, 1]; 0 if there is none.
  double within_share = 0.0;
  double wrong_share = 0.0;
  Statistics error_m;  // of the answered
  Statistics error_rad;
  std::vector<LocalizationQuery> per_query;
  // Of the reference, by the answers. If they are a body's, its constant rotation against the camera is not counted as
  // an error; if they are the same everywhere, positions alone decide.
  OrientationAgreement orientations;
};

// `only_times_ns`: counts only queries that have an entry there (say, the covered ones); nothing: all.
// Errors: InvalidArgument for bad options, FailedPrecondition if no query has a reference pose.
absl::StatusOr<LocalizationResult> EvaluateLocalization(
    std::span<const LocalizationAnswer> answers, std::span<const io::StampedPose> reference,
    const std::optional<std::vector<TimeNs>>& only_times_ns = std::nullopt, const LocalizationOptions& options = {});

// A text file with a time in seconds first on each line; lines starting with # are comments.
absl::StatusOr<std::vector<TimeNs>> ReadTimesFile(const std::string& path);

}  // namespace cairn::eval

#include "cli/prior_option.h"

#include <cmath>
#include <numbers>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"

namespace cairn::cli {
namespace {

// The numbers of an option, which must be `count`.
absl::StatusOr<std::vector<double>> Numbers(const std::string& text, std::size_t count, const char* option) {
  std::vector<double> numbers;
  for (const absl::string_view word : absl::StrSplit(text, absl::ByAnyChar(" ,\t"), absl::SkipEmpty())) {
    double number = 0.0;
    if (!absl::SimpleAtod(word, &number) || std::isnan(number)) {
      return absl::InvalidArgumentError(absl::StrCat(option, ": \"", word, "\" is not a number"));
    }
    numbers.push_back(number);
  }
  if (numbers.size() == count) return numbers;
  return absl::InvalidArgumentError(
      absl::StrCat(option, " takes ", count, " numbers in quotes, \"", text, "\" has ", numbers.size()));
}

}  // namespace

void AddPriorOptions(CLI::App* verb, PriorOptions* options) {
  verb->add_option("--prior", options->pose,
                   "Where the camera is thought to be, \"x y z qx qy qz qw\" (world_from_camera; of a map that is not "
                   "aligned map_from_camera): narrows the search, and excludes what only looks alike");
  verb->add_option("--prior-sigma", options->sigma,
                   "How far off the prior may be, \"METRES DEGREES\": standard deviations per axis");
  verb->add_option("--prior-component", options->component, "The prior is in the frame of this component of the map");
}

absl::StatusOr<std::optional<api::PosePrior>> ReadPrior(const PriorOptions& options) {
  if (options.pose.empty()) {
    if (options.sigma.empty() && options.component == 0) return std::nullopt;
    return absl::InvalidArgumentError("--prior-sigma and --prior-component go with --prior");
  }
  if (options.sigma.empty()) {
    return absl::InvalidArgumentError("--prior needs --prior-sigma \"METRES DEGREES\": how far off it may be");
  }
  CAIRN_ASSIGN_OR_RETURN(const std::vector<double> pose, Numbers(options.pose, 7, "--prior"));
  CAIRN_ASSIGN_OR_RETURN(const std::vector<double> sigma, Numbers(options.sigma, 2, "--prior-sigma"));
  const Quaterniond rotation(pose[6], pose[3], pose[4], pose[5]);
  constexpr double kUnit = 0.01;  // numbers are often written with few digits
  if (!(std::abs(rotation.norm() - 1.0) < kUnit)) {
    return absl::InvalidArgumentError(
        absl::StrCat("--prior: the quaternion qx qy qz qw has length ", rotation.norm(), ", not 1"));
  }
  for (const double number : pose) {
    if (!std::isfinite(number)) return absl::InvalidArgumentError("--prior: a number is not finite");
  }
  if (!(sigma[0] > 0.0 && sigma[1] > 0.0)) return absl::InvalidArgumentError("--prior-sigma: both must be positive");
  api::PosePrior prior;
  prior.map_from_camera = SE3(rotation.normalized(), Vector3d(pose[0], pose[1], pose[2]));
  prior.component = ComponentId(options.component);
  prior.position_sigma = sigma[0];
  prior.rotation_sigma_rad = sigma[1] * std::numbers::pi / 180.0;
  return prior;
}

}  // namespace cairn::cli

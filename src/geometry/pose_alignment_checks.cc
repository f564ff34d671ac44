// What a pose alignment leaves open, and what speaks against it.
#include <cmath>

#include "absl/strings/str_format.h"
#include "geometry/pose_alignment.h"

namespace cairn {
namespace {

constexpr double kDegPerRad = 57.29577951308232;

}  // namespace

absl::Status CheckDetermined(const PoseAlignment& alignment, const PoseAlignmentLimits& limits) {
  const double scale_share = alignment.RelativeScaleSigma();
  if (!(scale_share <= limits.max_relative_scale_sigma)) {
    return absl::FailedPreconditionError(absl::StrFormat(
        "the scale is not determined: %.4g +- %.2g (%.0f %%, at most %.0f %%): the positions spread over %.3g m only, "
        "with "
        "a noise of %.2g m. Orientations say nothing about it; poses over a longer path or more exact positions do",
        alignment.a_from_b.scale(), alignment.scale_sigma, 100.0 * scale_share, 100.0 * limits.max_relative_scale_sigma,
        alignment.spread, alignment.sigma_position));
  }
  if (!(alignment.rotation_sigma_rad <= limits.max_rotation_sigma_rad)) {
    return absl::FailedPreconditionError(absl::StrFormat(
        "the rotation is not determined: +- %.1f deg about its worst axis (at most %.1f deg): %s",
        alignment.rotation_sigma_rad * kDegPerRad, limits.max_rotation_sigma_rad * kDegPerRad,
        alignment.orientations_used
            ? "orientations and positions are too noisy, or too few. More poses, or a path that turns, help"
            : absl::StrCat("the positions alone do not show it, and the reference's orientations are ",
                           Describe(alignment.orientations.kind),
                           ". A reference with the camera's orientations, or a path that turns, helps")));
  }
  return absl::OkStatus();
}

absl::Status CheckFits(const PoseAlignment& alignment, const PoseAlignmentLimits& limits) {
  const int count = static_cast<int>(alignment.fits.size());
  const OrientationKind kind = alignment.orientations.kind;
  const bool contradicted = kind == OrientationKind::kUnrelated || kind == OrientationKind::kOtherFrame;
  const double min_share = contradicted ? limits.min_fit_share_contradicted : limits.min_fit_share;
  constexpr int kFitted = 7, kPerPair = 3;
  const int proven = kPerPair * alignment.fit_count - kFitted;
  const int thrown_away = kPerPair * (count - alignment.fit_count);
  if (alignment.fit_count >= min_share * count && proven > thrown_away) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrFormat(
      "only %d of %d poses fit one similarity (%.3g m RMSE; %.3g m over all): %s", alignment.fit_count, count,
      alignment.rmse_fits, alignment.rmse_all,
      contradicted ? "the others do not, and neither do the orientations" : "the others contradict it"));
}

}  // namespace cairn

#include "image/feature.h"

#include <cmath>

namespace cairn::image {

absl::Status OrbParameters::Validate() const {
  if (num_features < 1 || num_features > 100000) {
    return absl::InvalidArgumentError(
        absl::StrCat("orb num_features is ", num_features, "; it must be between 1 and 100000"));
  }
  if (num_levels < 1 || num_levels > 32) {
    return absl::InvalidArgumentError(absl::StrCat("orb num_levels is ", num_levels, "; it must be between 1 and 32"));
  }
  if (!(scale_factor > 1.0 && scale_factor <= 4.0)) {
    return absl::InvalidArgumentError(
        absl::StrCat("orb scale_factor is ", scale_factor, "; it must be above 1 and at most 4"));
  }
  if (fast_threshold < 1 || fast_threshold > 254) {
    return absl::InvalidArgumentError(
        absl::StrCat("orb fast_threshold is ", fast_threshold, " grey values; it must be between 1 and 254"));
  }
  if (min_fast_threshold < 1 || min_fast_threshold > fast_threshold) {
    return absl::InvalidArgumentError(absl::StrCat("orb min_fast_threshold is ", min_fast_threshold,
                                                   " grey values; it must be between 1 and fast_threshold (",
                                                   fast_threshold, ")"));
  }
  return absl::OkStatus();
}

}  // namespace cairn::image

#include "api/localizer.h"

namespace cairn::api {

const char* LocalizeStageName(LocalizeStage stage) {
  switch (stage) {
    case LocalizeStage::kFeatures:
      return "features";
    case LocalizeStage::kCandidates:
      return "place candidates";
    case LocalizeStage::kMatches:
      return "matches";
    case LocalizeStage::kPnp:
      return "PnP inliers";
    case LocalizeStage::kRefinement:
      return "refinement";
    case LocalizeStage::kDone:
      return "done";
  }
  return "unknown";
}

}  // namespace cairn::api

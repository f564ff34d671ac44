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
    case LocalizeStage::kRivals:
      return "ambiguous";
    case LocalizeStage::kDone:
      return "done";
  }
  return "unknown";
}

const char* LensUseName(LensUse use) {
  switch (use) {
    case LensUse::kNone:
      return "none";
    case LensUse::kCorrected:
      return "corrected";
    case LensUse::kOtherCalibration:
      return "other calibration";
  }
  return "unknown";
}

}  // namespace cairn::api

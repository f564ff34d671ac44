// Why an image is, or is not, found in a map: every stage of the search with its counts, the nearest keyframes, and
// what would help.
#pragma once

#include <string>
#include <vector>

#include "base/status.h"
#include "tracking/map_view.h"
#include "tracking/relocalization_trace.h"

namespace cairn::inspect {

// A keyframe near the pose that the search came to, or that is known from elsewhere.
struct NearKeyframe {
  KeyframeId keyframe;
  double distance = 0.0;        // in the unit of Placed() (measures.h)
  double distance_share = 0.0;  // of the median depth of its points
  double angle_deg = 0.0;       // between the optical axes
};

struct Explanation {
  tracking::Relocalization result;
  tracking::RelocalizationTrace trace;
  // The group that got furthest, an index into trace.groups; -1: none was matched.
  int best_group = -1;
  // Where the camera is, or may be: of the answer, of the attempt that got furthest, or the given one.
  bool has_pose = false;
  bool pose_is_given = false;
  ComponentId component;
  SE3 camera_from_map;
  std::vector<NearKeyframe> near;  // the most alike view first
  std::vector<std::string> advice;
};

struct ExplainOptions {
  tracking::RelocalizerOptions relocalizer;
  int near_keyframes = 5;
};

// `area` as for Relocalizer; a prior in it is taken for where the camera is. Errors as of Relocalizer.
absl::StatusOr<Explanation> Explain(const tracking::MapView& view, const Pinhole& pinhole,
                                    const image::Features& features, const tracking::SearchArea& area = {},
                                    const ExplainOptions& options = {});

// "features", "candidates", "matches", "pnp", "refinement", "rivals", "done".
const char* StageName(tracking::RelocalizationStage stage);

}  // namespace cairn::inspect

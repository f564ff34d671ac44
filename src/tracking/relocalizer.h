// "Where is this camera?" without any prior knowledge of the pose, or with some, against one revision of a map.
//
// Stages: candidate keyframes by shared words, grouped by covisibility (Mur-Artal, Tardos, "Fast relocalisation and
// loop closing in keyframe-based SLAM", ICRA 2014); 2D-3D matches with all points of a group; PnP in RANSAC; guided
// search over the local map in rounds of shrinking radius, each with motion-only bundle adjustment; acceptance by
// evidence; rivals: other places of the map that look alike are asked, too. A miss names the stage that failed.
//
// The best group is tried first. Where it fails, the others are matched, and those with most matches are tried: an
// image of elsewhere has about as many wrong matches with each, and is given up after few.
#pragma once

#include "base/status.h"
#include "geometry/pinhole.h"
#include "image/feature.h"
#include "map/snapshot.h"
#include "tracking/place_index.h"
#include "tracking/place_prior.h"
#include "tracking/relocalization.h"
#include "tracking/relocalizer_options.h"

namespace cairn::tracking {

class Relocalizer {
 public:
  explicit Relocalizer(const RelocalizerOptions& options = {}) : options_(options) {}

  const RelocalizerOptions& options() const { return options_; }

  // A miss is an answer. The same input gives the same answer; may be called by several threads at once.
  // InvalidArgument: bad options, camera or prior. FailedPrecondition: `places` is of another revision than `map`.
  absl::StatusOr<Relocalization> Relocalize(const map::Snapshot& map, const PlaceIndex& places, const Pinhole& pinhole,
                                            const image::Features& features, const SearchArea& area = {}) const;

 private:
  RelocalizerOptions options_;
};

}  // namespace cairn::tracking

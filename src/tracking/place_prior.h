// Where a camera is thought to be before its image is looked at: it narrows a search in the map.
#pragma once

#include <vector>

#include "base/ids.h"
#include "base/status.h"
#include "geometry/se3.h"
#include "map/snapshot.h"

namespace cairn::tracking {

// In the frame of one component. Independent standard deviations per axis.
struct PlacePrior {
  ComponentId component;
  SE3 map_from_camera;
  double translation_sigma = 0.0;  // map units; infinite: unknown
  double rotation_sigma_rad = 0.0;

  // InvalidArgument: no component, a pose that is not finite, a sigma that is not positive.
  absl::Status Validate() const;

  // How far a pose in that component is from it, in standard deviations of the position or of the direction, whichever
  // is more.
  double SigmasFrom(const SE3& other_map_from_camera) const;
};

// Which part of the map counts.
struct SearchArea {
  ComponentId only;    // none: all ...
  ComponentId except;  // ... but this
  // Not empty: only where one of them allows the camera to be.
  std::vector<PlacePrior> priors;

  static SearchArea Only(ComponentId component) { return {component, {}, {}}; }
  static SearchArea Except(ComponentId component) { return {{}, component, {}}; }

  bool Contains(ComponentId component) const {
    return (!only || component == only) && (!except || component != except);
  }
  // Whether a camera that the area allows may see what the keyframe sees.
  bool MayShareView(const map::Snapshot& map, const map::Keyframe& keyframe) const;
  // How far a pose is from the nearest prior of its component, as PlacePrior::SigmasFrom; 0 without priors.
  double SigmasFrom(ComponentId component, const SE3& map_from_camera) const;
};

// A pose farther from the prior than this is none that it allows: of three axes, one in a thousand is farther.
constexpr double kMaxPriorSigmas = 4.0;

}  // namespace cairn::tracking

// What aligning by poses, by geographic positions and by known places have in common: the components of a map, and what
// a reference says about each. For map_alignment.cc and its parts.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "api/map_alignment.h"
#include "base/status.h"
#include "geometry/pose_association.h"
#include "map/edit.h"
#include "map/snapshot.h"

namespace cairn::engine {

struct AlignmentTarget {
  ComponentId component;
  std::optional<Sim3> world_from_component;  // as it is aligned now
  std::vector<StampedPose> keyframes;        // map_from_camera, in the order of time
  std::vector<KeyframeId> ids;               // of these
  std::vector<Association> pairs;            // with the reference
};

// One for each component that has keyframes, without pairs; keyframes of request.session only, if one is named.
// NotFound if there is no such session.
absl::StatusOr<std::vector<AlignmentTarget>> TargetsOf(const std::string& map, const map::Snapshot& snapshot,
                                                       const api::AlignRequest& request);
// The one that is asked for, or that most of the reference is of.
absl::StatusOr<std::size_t> ChooseTarget(const std::string& map, const std::vector<AlignmentTarget>& targets,
                                         const api::AlignRequest& request);
std::vector<api::ComponentAlignment::Other> OthersOf(const std::vector<AlignmentTarget>& targets, std::size_t chosen);

// By which the keyframes move in the world, against the alignment there was; none: there was none.
std::optional<double> MedianMove(const AlignmentTarget& target, const Sim3& world_from_component);

// What a request found, to be stored: `edit` has it already.
absl::StatusOr<api::ComponentAlignment> AlignByPoses(const std::string& map, const api::AlignRequest& request,
                                                     map::Edit* edit);
absl::StatusOr<api::ComponentAlignment> AlignByPositions(const std::string& map, const api::AlignRequest& request,
                                                         map::Edit* edit);

// By api::KnownPlaces: closed forms over a few numbers. NotFound for a landmark that there is not, AlreadyExists for
// what would have to be overwritten, FailedPrecondition for what leaves something open or contradicts itself,
// InvalidArgument for landmarks of several components.
absl::StatusOr<api::ComponentAlignment> AlignByPlaces(const std::string& map, const api::AlignRequest& request,
                                                      map::Edit* edit);

void PutAlignment(ComponentId component, const Sim3& world_from_component, map::Edit* edit);

// Whether a new alignment and the one there is can both be right: frames of reference differ in place and rotation, not
// in size. `relative_sigma`: of `scale`.
absl::Status CheckScaleAgainst(const Sim3& before, double scale, double relative_sigma);

}  // namespace cairn::engine

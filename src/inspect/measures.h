// What can be measured of keyframes and points of a map: how far observations lie from where they should, how far
// points are away, from how different sides they are seen. Pixels are those of the undistorted image, lengths are map
// units of the component unless said otherwise.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/status.h"
#include "map/snapshot.h"

namespace cairn::inspect {

// Of a feature that observes a point in front of the camera; none of others. `error` is keypoint minus projection.
struct MeasuredObservation {
  std::uint32_t feature = 0;
  PointId point;
  Vector2d error_px = Vector2d::Zero();
  double depth = 0.0;
  int octave = 0;
};
std::optional<MeasuredObservation> Measure(const map::Snapshot& map, const map::Keyframe& keyframe,
                                           std::uint32_t feature);
// All of a keyframe, in the order of its features.
std::vector<MeasuredObservation> Measure(const map::Snapshot& map, const map::Keyframe& keyframe);

// Root of the mean square; none without observations.
std::optional<double> ErrorRmsPx(const std::vector<MeasuredObservation>& observations);
std::optional<double> ErrorRmsPx(const map::Snapshot& map, const map::MapPoint& point);
// Of the depths; 0 without any.
double MedianDepth(const std::vector<MeasuredObservation>& observations);

int NumPoints(const map::Keyframe& keyframe);
// Neighbours with at least map::kMinCovisiblePoints points in common.
int NumCovisible(const map::Keyframe& keyframe);

// The largest angle between two of the rays along which the point is seen: 2 x the largest from their mean would not
// be exact, so all pairs are compared, of at most 32 rays spread evenly over the observations.
double ParallaxDeg(const map::Snapshot& map, const map::MapPoint& point);

// The component of a point.
ComponentId ComponentOf(const map::Snapshot& map, const map::MapPoint& point);

// In metres in the world if the component is aligned, else as it is.
Vector3d Placed(const map::Snapshot& map, ComponentId component, const Vector3d& position);
SE3 PlacedPose(const map::Snapshot& map, const map::Keyframe& keyframe);
// Length of one map unit in the unit of Placed().
double PlacedScale(const map::Snapshot& map, ComponentId component);

// Components of which places and lengths can be told together: all that are aligned, or without any the one with most
// keyframes. Ascending.
std::vector<ComponentId> TogetherInOneFrame(const map::Snapshot& map);

// Components with keyframes that are not among `told`, and their keyframes.
struct LeftOut {
  int components = 0;
  std::int64_t keyframes = 0;
  // "without 9 keyframes of 2 components in other frames"; empty: nothing is left out.
  std::string Text() const;
};
LeftOut LeftOutBesides(const map::Snapshot& map, const std::vector<ComponentId>& told);

// Of what was looked at so far of a map that comes from its file bit by bit: whether all of it could be read. What
// could not is there all the same, without content that means anything (map/entity_source.h).
absl::Status StatusOfRead(const map::Snapshot& map);

// Angle between the optical axes of two cameras, degrees.
double AxisAngleDeg(const SE3& a_from_map, const SE3& b_from_map);

}  // namespace cairn::inspect

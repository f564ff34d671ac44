// From where, and from how far, a map point can be found again: derived from the keyframes that observe it, with the
// same result to the bit wherever it is computed, so that it need not be stored.
#pragma once

#include <span>

#include "map/entities.h"

namespace cairn::map {

struct Viewing {
  Eigen::Vector3f mean_direction = Eigen::Vector3f::Zero();  // unit, from the cameras to the point
  float min_distance = 0.0f;                                 // map units
  float max_distance = 0.0f;
};

// `camera_centers`: of the observing keyframes in the order of the point's observations; `reference_center` and
// `reference_octave`: of the reference observation. All positions in the map frame.
// Seen at octave o from distance d, the point would be at octave 0 from d * scale^o, and at the last one from that /
// scale^last (Mur-Artal, Montiel, Tardos: "ORB-SLAM: a versatile and accurate monocular SLAM system", T-RO 2015, Sec.
// III-C).
Viewing ComputeViewing(const Vector3d& position, std::span<const Vector3d> camera_centers,
                       const Vector3d& reference_center, int reference_octave, const image::OrbParameters& orb);

inline void SetViewing(const Viewing& viewing, MapPoint* point) {
  point->mean_view_direction = viewing.mean_direction;
  point->min_distance = viewing.min_distance;
  point->max_distance = viewing.max_distance;
}

}  // namespace cairn::map

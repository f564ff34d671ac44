// From where, and from how far, a map point can be found again: derived from the keyframes that observe it, with the
// same result to the bit wherever it is computed, so that it need not be stored.
#pragma once

#include <span>

#include "map/entities.h"

namespace cairn::map {

struct Viewing {
  Eigen::Vector3f mean_direction = Eigen::Vector3f::Zero();  // unit, from the cameras to the point
  float pixel_size = 0.0f;                                   // map units
};

// `camera_centers`: of the observing keyframes in the order of the point's observations; `reference_center`,
// `reference_octave` and `reference_focal_px`: of the reference observation. All positions in the map frame.
// A pixel of octave o is scale^o pixels of the image wide, and at distance d of a camera of focal length f it covers
// pixel_size = d scale^o / f. A camera of focal length f' at distance d' finds the same patch at the octave o' with
// d' scale^o' / f' = pixel_size: the scale prediction of Mur-Artal, Montiel, Tardos ("ORB-SLAM", T-RO 2015, Sec.
// III-C), for cameras that differ.
Viewing ComputeViewing(const Vector3d& position, std::span<const Vector3d> camera_centers,
                       const Vector3d& reference_center, int reference_octave, double reference_focal_px,
                       const image::OrbParameters& orb);

// The distances between which a camera of that focal length finds the point at some pyramid level.
struct DistanceRange {
  double min = 0.0;
  double max = 0.0;
};
inline DistanceRange FindableWithin(double pixel_size, double focal_px, const image::OrbParameters& orb) {
  const double max = pixel_size * focal_px;
  return {max / orb.Scale(orb.num_levels - 1), max};
}

inline void SetViewing(const Viewing& viewing, MapPoint* point) {
  point->mean_view_direction = viewing.mean_direction;
  point->pixel_size = viewing.pixel_size;
}

}  // namespace cairn::map

/// \file
/// Where something is, and how surely. conversions.h makes Eigen's types of these.
#pragma once

#include <array>
#include <cstdint>

#include "cairn/export.h"

CAIRN_BEGIN_NAMESPACE

/// A rigid transform, named a_from_b: it takes a point in frame b to frame a. map_from_camera.translation is the place
/// of the camera in the map. The camera looks along +z, x is right, y down.
struct Pose {
  std::array<double, 3> translation{{0.0, 0.0, 0.0}};         ///< in units of frame a
  std::array<double, 4> rotation_xyzw{{0.0, 0.0, 0.0, 1.0}};  ///< unit quaternion, qx qy qz qw
};

/// point_a = scale * rotation * point_b + translation.
struct Similarity {
  Pose pose;           ///< rotation and translation
  double scale = 1.0;  ///< units of frame a per unit of frame b
};

/// Row by row, of a left increment (translation, rotation) of a pose: in units of its frame and radians. Such an
/// increment turns about the origin of the frame; PositionCovariance() is about the camera.
using PoseCovariance = std::array<double, 36>;

/// The point in frame a.
CAIRN_API std::array<double, 3> Transform(const Pose& a_from_b, const std::array<double, 3>& point_b) noexcept;
/// a_from_c.
CAIRN_API Pose Compose(const Pose& a_from_b, const Pose& b_from_c) noexcept;
/// b_from_a.
CAIRN_API Pose Inverse(const Pose& a_from_b) noexcept;

/// Of the camera's place, row by row, in units of the map squared. For metres multiply by world_per_map squared (and
/// turn it by world_from_map's rotation).
CAIRN_API std::array<double, 9> PositionCovariance(const Pose& map_from_camera,
                                                   const PoseCovariance& covariance) noexcept;
/// The root of its trace: how far off the place is likely to be, in units of the map.
CAIRN_API double PositionSigma(const Pose& map_from_camera, const PoseCovariance& covariance) noexcept;
/// How far the orientation is likely to be turned, radians.
CAIRN_API double RotationSigmaRad(const PoseCovariance& covariance) noexcept;

CAIRN_END_NAMESPACE

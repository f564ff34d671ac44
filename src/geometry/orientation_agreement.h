// Do the orientations of a reference mean what they should? A reference of a recording may hold the camera's
// orientations, those of a body that the camera is mounted on (an IMU, a car), or numbers that mean nothing (the
// identity on every line of a GPS track, the course instead of the heading).
//
// With a_from_b unknown only relative rotations can be compared: between two times, the camera of map b turned by
// D_b = R_b,i^T R_b,j and what the reference a describes by D_a. For the camera itself D_a = D_b. For a body with a
// constant mount rotation C = b_from_a (camera from body) D_a = C^T D_b C: the angles are the same and the axes are
// turned (the rotation part of hand-eye calibration; Park, Martin, "Robot sensor calibration: solving AX = XB on the
// Euclidean group", T-RA 1994).
#pragma once

#include <cstdint>
#include <span>

#include "geometry/se3.h"

namespace cairn {

enum class OrientationKind : std::uint8_t {
  kCamera,     // those of the camera
  kBody,       // those of a body to which the camera is fixed, turned by more than a few degrees
  kConstant,   // the same everywhere although the camera turns, or the identity everywhere: they mean nothing
  kUnrelated,  // they turn, but not as the camera does
  // Relative rotations agree, but the positions are not in the same frame: a_from_b of the orientations does not take
  // the positions of b to those of a. Found by AlignPoses, not here.
  kOtherFrame,
  kIgnored,  // not looked at
};

struct OrientationAgreement {
  OrientationKind kind = OrientationKind::kIgnored;
  // Camera from body; the identity but for kBody.
  Quaterniond camera_from_body = Quaterniond::Identity();
  // False: the camera hardly turned, so that the camera and a body cannot be told apart by relative rotations.
  bool turns = false;
  // Median rotation between the compared times in b, and the median difference of a's to it: as they are, and with the
  // best mount rotation.
  double turned_rad = 0.0;
  double difference_rad = 0.0;
  double mounted_difference_rad = 0.0;
  // Share of the comparisons that agree, as they are and with the best mount rotation.
  double agreeing_share = 0.0;
  double mounted_agreeing_share = 0.0;
  // Of kUnrelated: inverted they agree; a holds camera_from_world instead of world_from_camera.
  bool inverted = false;
};

struct OrientationAgreementOptions {
  // Two times tell something about a mount if the camera turned by at least this between them.
  double min_turn_rad = 0.10;
  // A relative rotation agrees if it differs by no more than this, or than this share of its angle.
  double tolerance_rad = 0.05;
  double tolerance_share = 0.15;
  // With a third of the poses wrong less than half of the pairs are right; by chance about a tenth agrees.
  double min_agreeing_share = 0.3;
  // A mount turned by less counts as the camera itself: a depth camera beside a colour camera, a lens a bit askew.
  double min_mount_rad = 0.087;
  std::uint64_t seed = 1;
};

// Pairs of poses at the same times, in the order of time: a_from_body (or camera) and b_from_camera. Fewer than 3
// pairs, or spans of different sizes, give kIgnored.
OrientationAgreement CompareOrientations(std::span<const SE3> poses_a, std::span<const SE3> poses_b,
                                         const OrientationAgreementOptions& options = {});

// Ends a sentence that begins with "its orientations are": "the camera's", "the same everywhere and mean nothing", ...
const char* Describe(OrientationKind kind);

}  // namespace cairn

// Reference trajectories as recordings have them, made comparable with a camera's poses: the ground truth of a body
// gets the camera's place on it, and what its orientations are is found out.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "geometry/orientation_agreement.h"
#include "io/trajectory.h"

namespace cairn::eval {

struct ReferenceOptions {
  // File with body_from_camera (EuRoC's sensor.yaml). Empty: for an EuRoC csv the one of the first camera beside it, if
  // there is one. "none": poses are taken as they are.
  std::string sensor;
};

struct Reference {
  io::Trajectory trajectory;            // of the camera, where body_from_camera is known
  std::optional<SE3> body_from_camera;  // as it was applied
  std::string sensor;                   // file that it is from
  bool is_body = false;                 // an EuRoC csv without body_from_camera: poses of the body
};

absl::StatusOr<Reference> LoadReference(const std::string& path, const ReferenceOptions& options = {});

// What was done to the poses when they were read, for people; empty: nothing.
std::string Describe(const Reference& reference);

// What the orientations of a reference turned out to be, for people: "" for the camera's.
std::string Describe(const OrientationAgreement& orientations);

// "camera", "body", "constant", "unrelated", "other frame", "ignored": for machines.
const char* NameOf(OrientationKind kind);

// The orientation of the camera from that of the body it is fixed to; the position stays the body's.
SE3 WithMount(const SE3& world_from_body, const Quaterniond& camera_from_body);

// What the orientations of poses in the estimate's own frame are: kBody only where one mount rotation explains the
// difference of most.
OrientationAgreement OrientationsInOneFrame(std::span<const SE3> groundtruth, std::span<const SE3> estimate);

}  // namespace cairn::eval

#include "eval/reference.h"

#include "absl/strings/str_format.h"
#include "geometry/pose_alignment_start.h"
#include "io/body_camera.h"

namespace cairn::eval {

absl::StatusOr<Reference> LoadReference(const std::string& path, const ReferenceOptions& options) {
  Reference reference;
  CAIRN_ASSIGN_OR_RETURN(reference.trajectory, io::ReadTrajectory(path));
  const bool of_body = reference.trajectory.format == io::TrajectoryFormat::kEuroc;
  if (options.sensor == "none") {
    reference.is_body = of_body;
    return reference;
  }
  if (!options.sensor.empty()) {
    reference.sensor = options.sensor;
    CAIRN_ASSIGN_OR_RETURN(reference.body_from_camera, io::ReadBodyFromCamera(options.sensor));
  } else if (of_body) {
    if (const std::optional<std::string> sensor = io::SensorBesideGroundtruth(path)) {
      reference.sensor = *sensor;
      CAIRN_ASSIGN_OR_RETURN(reference.body_from_camera, io::FindBodyFromCamera(*sensor));
    }
  }
  reference.is_body = of_body && !reference.body_from_camera;
  if (reference.body_from_camera) {
    for (io::StampedPose& pose : reference.trajectory.poses) {
      pose.world_from_camera = pose.world_from_camera * *reference.body_from_camera;
    }
  }
  return reference;
}

std::string Describe(const Reference& reference) {
  if (reference.body_from_camera) {
    return absl::StrFormat("the reference is of the body; the camera is %.3f m from it by T_BS of %s",
                           reference.body_from_camera->translation().norm(), reference.sensor);
  }
  if (reference.is_body) {
    return "the reference is of the body, where the camera sits on it is not known: give --sensor sensor.yaml";
  }
  return "";
}

std::string Describe(const OrientationAgreement& orientations) {
  constexpr double kDegPerRad = 57.29577951308232;
  switch (orientations.kind) {
    case OrientationKind::kCamera:
      return "";
    case OrientationKind::kBody:
      return absl::StrFormat(
          "the reference's orientations are those of a body that is turned by %.1f deg against the camera, which is "
          "not "
          "counted as an error",
          AngleRad(orientations.camera_from_body) * kDegPerRad);
    case OrientationKind::kUnrelated:
      return absl::StrFormat(
          "the reference's orientations are %s: where the camera turns by %.1f deg, they differ by %.1f deg",
          cairn::Describe(orientations.kind), orientations.turned_rad * kDegPerRad,
          orientations.difference_rad * kDegPerRad);
    default:
      return absl::StrCat("the reference's orientations are ", cairn::Describe(orientations.kind));
  }
}

const char* NameOf(OrientationKind kind) {
  switch (kind) {
    case OrientationKind::kCamera:
      return "camera";
    case OrientationKind::kBody:
      return "body";
    case OrientationKind::kConstant:
      return "constant";
    case OrientationKind::kUnrelated:
      return "unrelated";
    case OrientationKind::kOtherFrame:
      return "other frame";
    case OrientationKind::kIgnored:
      return "ignored";
  }
  return "";
}

SE3 WithMount(const SE3& world_from_body, const Quaterniond& camera_from_body) {
  return SE3(world_from_body.rotation() * camera_from_body.conjugate(), world_from_body.translation());
}

OrientationAgreement OrientationsInOneFrame(std::span<const SE3> groundtruth, std::span<const SE3> estimate) {
  OrientationAgreement orientations = CompareOrientations(groundtruth, estimate);
  if (orientations.kind != OrientationKind::kBody) return orientations;
  // A turn about the only axis that the camera turned about is open in relative rotations, not in these.
  std::vector<Quaterniond> mounts;
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    mounts.push_back(estimate[i].rotation().conjugate() * groundtruth[i].rotation());
  }
  orientations.camera_from_body = VotedRotation(mounts);
  return orientations;
}

}  // namespace cairn::eval

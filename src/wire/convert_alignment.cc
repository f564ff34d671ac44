#include "wire/convert_alignment.h"

#include <array>
#include <utility>

#include "wire/convert.h"
#include "wire/reading.h"
#include "wire/text.h"

namespace cairn::wire {
namespace {

using Alignment = v1::ComponentAlignment;

constexpr std::array<std::pair<OrientationKind, Alignment::Orientations>, 6> kOrientations = {{
    {OrientationKind::kIgnored, Alignment::ORIENTATIONS_IGNORED},
    {OrientationKind::kCamera, Alignment::ORIENTATIONS_CAMERA},
    {OrientationKind::kBody, Alignment::ORIENTATIONS_BODY},
    {OrientationKind::kConstant, Alignment::ORIENTATIONS_CONSTANT},
    {OrientationKind::kUnrelated, Alignment::ORIENTATIONS_UNRELATED},
    {OrientationKind::kOtherFrame, Alignment::ORIENTATIONS_OTHER_FRAME},
}};

Alignment::Orientations WriteKind(OrientationKind kind) {
  for (const auto& [value, message] : kOrientations) {
    if (value == kind) return message;
  }
  return Alignment::ORIENTATIONS_UNSPECIFIED;
}

OrientationKind ReadKind(Alignment::Orientations kind) {
  for (const auto& [value, message] : kOrientations) {
    if (message == kind) return value;
  }
  return OrientationKind::kIgnored;
}

void WriteBy(const api::ReferencePoses& reference, v1::AlignMapRequest* out) {
  v1::ReferencePoses* poses = out->mutable_poses();
  for (const StampedPose& pose : reference.poses) {
    v1::StampedPose* stamped = poses->add_poses();
    stamped->set_time_ns(pose.time_ns);
    ToProto(pose.world_from_camera, stamped->mutable_world_from_camera());
  }
  poses->set_positions_only(!reference.solver.use_orientations);
  poses->set_sigma_position(reference.solver.sigma_position);
  poses->set_sigma_rotation_rad(reference.solver.sigma_rotation_rad);
}

void WriteBy(const api::GeoPositions& reference, v1::AlignMapRequest* out) {
  for (const api::GeoPositions::At& at : reference.positions) {
    v1::GeoPositions::At* position = out->mutable_positions()->add_positions();
    position->set_keyframe(at.keyframe.value());
    position->set_time_ns(at.time_ns);
    ToProto(at.position, position->mutable_position());
  }
}

void WriteLandmark(const api::Landmark& landmark, v1::Landmark* out) {
  if (const auto* point = std::get_if<PointId>(&landmark)) {
    out->set_point(point->value());
  } else if (const auto* keyframe = std::get_if<KeyframeId>(&landmark)) {
    out->set_keyframe(keyframe->value());
  } else {
    const auto& seen = std::get<api::SeenAt>(landmark);
    out->mutable_seen()->set_keyframe(seen.keyframe.value());
    out->mutable_seen()->set_x_px(seen.pixel.x());
    out->mutable_seen()->set_y_px(seen.pixel.y());
  }
}

absl::StatusOr<api::Landmark> ReadLandmark(const v1::Landmark& message) {
  switch (message.place_case()) {
    case v1::Landmark::kPoint:
      return PointId(message.point());
    case v1::Landmark::kKeyframe:
      return KeyframeId(message.keyframe());
    case v1::Landmark::kSeen:
      return api::SeenAt{KeyframeId(message.seen().keyframe()), {message.seen().x_px(), message.seen().y_px()}};
    case v1::Landmark::PLACE_NOT_SET:
      break;
  }
  return absl::InvalidArgumentError("align: a place is a point, a keyframe, or what is seen in one");
}

void WriteBy(const api::KnownPlaces& known, v1::AlignMapRequest* out) {
  v1::KnownPlaces* places = out->mutable_places();
  for (const api::KnownPosition& known_position : known.positions) {
    v1::KnownPlaces::Position* position = places->add_positions();
    WriteLandmark(known_position.of, position->mutable_of());
    Write(known_position.world_m, position->mutable_world_m());
  }
  for (const api::KnownDistance& known_distance : known.distances) {
    v1::KnownPlaces::Distance* distance = places->add_distances();
    WriteLandmark(known_distance.from, distance->mutable_from());
    WriteLandmark(known_distance.to, distance->mutable_to());
    distance->set_metres(known_distance.metres);
  }
  if (known.gravity) Write(*known.gravity, places->mutable_gravity());
  places->set_upright_cameras(known.upright_cameras);
}

absl::StatusOr<api::KnownPlaces> ReadPlaces(const v1::KnownPlaces& message) {
  api::KnownPlaces known;
  for (const v1::KnownPlaces::Position& position : message.positions()) {
    api::KnownPosition& place = known.positions.emplace_back();
    CAIRN_ASSIGN_OR_RETURN(place.of, ReadLandmark(position.of()));
    CAIRN_ASSIGN_OR_RETURN(place.world_m, Read(position.world_m()));
  }
  for (const v1::KnownPlaces::Distance& distance : message.distances()) {
    api::KnownDistance& places = known.distances.emplace_back();
    CAIRN_ASSIGN_OR_RETURN(places.from, ReadLandmark(distance.from()));
    CAIRN_ASSIGN_OR_RETURN(places.to, ReadLandmark(distance.to()));
    places.metres = distance.metres();
  }
  if (message.has_gravity()) {
    CAIRN_ASSIGN_OR_RETURN(known.gravity, Read(message.gravity()));
  }
  known.upright_cameras = message.upright_cameras();
  return known;
}

void WriteBy(const map::GeoAnchor& anchor, v1::AlignMapRequest* out) { ToProto(anchor, out->mutable_anchor()); }
void WriteBy(const api::NoGeoAnchor&, v1::AlignMapRequest* out) { out->set_remove_anchor(true); }

absl::StatusOr<api::ReferencePoses> ReadPoses(const v1::ReferencePoses& message) {
  api::ReferencePoses reference;
  for (const v1::StampedPose& stamped : message.poses()) {
    StampedPose& pose = reference.poses.emplace_back();
    pose.time_ns = stamped.time_ns();
    CAIRN_ASSIGN_OR_RETURN(pose.world_from_camera, FromProto(stamped.world_from_camera()));
  }
  reference.solver.use_orientations = !message.positions_only();
  reference.solver.sigma_position = message.sigma_position();
  reference.solver.sigma_rotation_rad = message.sigma_rotation_rad();
  return reference;
}

absl::StatusOr<api::GeoPositions> ReadPositions(const v1::GeoPositions& message) {
  api::GeoPositions reference;
  for (const v1::GeoPositions::At& at : message.positions()) {
    api::GeoPositions::At& position = reference.positions.emplace_back();
    position.keyframe = KeyframeId(at.keyframe());
    position.time_ns = at.time_ns();
    CAIRN_ASSIGN_OR_RETURN(position.position, FromProto(at.position()));
  }
  return reference;
}

void WriteComponent(const api::ComponentAlignment& found, Alignment* out) {
  out->set_component(found.component.value());
  ToProto(found.world_from_component, out->mutable_world_from_component());
  out->set_keyframes(found.keyframes);
  out->set_with_reference(found.with_reference);
  out->set_fitting(found.fitting);
  for (const double time_s : found.misfits_s) out->add_misfits_s(time_s);
  out->set_rmse_fitting_m(found.rmse_fitting_m);
  out->set_rmse_all_m(found.rmse_all_m);
  out->set_scale_sigma(found.scale_sigma);
  out->set_rotation_sigma_rad(found.rotation_sigma_rad);
  out->set_position_sigma_m(found.position_sigma_m);
  out->set_noise_position_m(found.noise_position_m);
  out->set_noise_rotation_rad(found.noise_rotation_rad);
  out->set_orientations(WriteKind(found.orientations.kind));
  out->set_orientations_used(found.orientations_used);
  Write(found.orientations.camera_from_body, out->mutable_camera_from_body());
  out->set_turned_rad(found.orientations.turned_rad);
  out->set_difference_rad(found.orientations.difference_rad);
  out->set_camera_in_body_m(found.camera_in_body_m);
  out->set_camera_in_body_sigma_m(found.camera_in_body_sigma_m);
  for (const double error_m : found.errors_m) out->add_errors_m(error_m);
  if (found.moved_m) out->set_moved_m(*found.moved_m);
  for (const api::ComponentAlignment::Other& other : found.others) {
    Alignment::Other* told = out->add_others();
    told->set_component(other.component.value());
    told->set_keyframes(other.keyframes);
    told->set_with_reference(other.with_reference);
    told->set_aligned(other.aligned);
  }
}

absl::StatusOr<api::ComponentAlignment> ReadComponent(const Alignment& message) {
  api::ComponentAlignment found;
  found.component = ComponentId(message.component());
  CAIRN_ASSIGN_OR_RETURN(found.world_from_component, FromProto(message.world_from_component()));
  found.keyframes = message.keyframes();
  found.with_reference = message.with_reference();
  found.fitting = message.fitting();
  found.misfits_s.assign(message.misfits_s().begin(), message.misfits_s().end());
  found.rmse_fitting_m = message.rmse_fitting_m();
  found.rmse_all_m = message.rmse_all_m();
  found.scale_sigma = message.scale_sigma();
  found.rotation_sigma_rad = message.rotation_sigma_rad();
  found.position_sigma_m = message.position_sigma_m();
  found.noise_position_m = message.noise_position_m();
  found.noise_rotation_rad = message.noise_rotation_rad();
  found.orientations.kind = ReadKind(message.orientations());
  found.orientations_used = message.orientations_used();
  CAIRN_ASSIGN_OR_RETURN(found.orientations.camera_from_body, Read(message.camera_from_body()));
  found.orientations.turned_rad = message.turned_rad();
  found.orientations.difference_rad = message.difference_rad();
  found.camera_in_body_m = message.camera_in_body_m();
  found.camera_in_body_sigma_m = message.camera_in_body_sigma_m();
  found.errors_m.assign(message.errors_m().begin(), message.errors_m().end());
  if (message.has_moved_m()) found.moved_m = message.moved_m();
  for (const Alignment::Other& other : message.others()) {
    found.others.push_back(
        {ComponentId(other.component()), other.keyframes(), other.with_reference(), other.aligned()});
  }
  return found;
}

}  // namespace

void ToProto(const GeoPosition& position, v1::GeoPosition* out) {
  out->set_latitude_deg(position.latitude_deg);
  out->set_longitude_deg(position.longitude_deg);
  out->set_height_m(position.height_m);
}

absl::StatusOr<GeoPosition> FromProto(const v1::GeoPosition& message) {
  const GeoPosition position{message.latitude_deg(), message.longitude_deg(), message.height_m()};
  CAIRN_RETURN_IF_ERROR(position.Validate());
  return position;
}

void ToProto(const map::GeoAnchor& anchor, v1::GeoAnchor* out) {
  out->set_latitude_deg(anchor.latitude_deg);
  out->set_longitude_deg(anchor.longitude_deg);
  out->set_height_m(anchor.height_m);
  Write(anchor.enu_from_world, out->mutable_enu_from_world());
}

absl::StatusOr<map::GeoAnchor> FromProto(const v1::GeoAnchor& message) {
  map::GeoAnchor anchor{message.latitude_deg(), message.longitude_deg(), message.height_m(), Quaterniond::Identity()};
  CAIRN_ASSIGN_OR_RETURN(anchor.enu_from_world, Read(message.enu_from_world()));
  CAIRN_RETURN_IF_ERROR(anchor.Validate());
  return anchor;
}

void ToProto(const api::AlignRequest& request, v1::AlignMapRequest* out) {
  std::visit([&](const auto& by) { WriteBy(by, out); }, request.by);
  out->set_source(Utf8(request.source));
  out->set_component(request.component.value());
  out->set_session(request.session.value());
  out->set_max_dt_s(request.max_dt_s);
  out->set_overwrite(request.overwrite);
  out->set_force(request.force);
}

absl::StatusOr<api::AlignRequest> FromProto(const v1::AlignMapRequest& message) {
  api::AlignRequest request;
  switch (message.by_case()) {
    case v1::AlignMapRequest::kPoses: {
      CAIRN_ASSIGN_OR_RETURN(request.by, ReadPoses(message.poses()));
      break;
    }
    case v1::AlignMapRequest::kPositions: {
      CAIRN_ASSIGN_OR_RETURN(request.by, ReadPositions(message.positions()));
      break;
    }
    case v1::AlignMapRequest::kPlaces: {
      CAIRN_ASSIGN_OR_RETURN(request.by, ReadPlaces(message.places()));
      break;
    }
    case v1::AlignMapRequest::kAnchor: {
      CAIRN_ASSIGN_OR_RETURN(request.by, FromProto(message.anchor()));
      break;
    }
    case v1::AlignMapRequest::kRemoveAnchor:
      request.by = api::NoGeoAnchor();
      if (message.remove_anchor()) break;
      [[fallthrough]];
    case v1::AlignMapRequest::BY_NOT_SET:
      return absl::InvalidArgumentError("align: poses, positions, places, anchor or remove_anchor is needed");
  }
  request.source = message.source().empty() ? "the reference" : message.source();
  request.component = ComponentId(message.component());
  request.session = SessionId(message.session());
  request.max_dt_s = message.max_dt_s();
  request.overwrite = message.overwrite();
  request.force = message.force();
  return request;
}

void ToProto(const api::AlignAnswer& answer, v1::AlignMapResponse* out) {
  out->set_revision(answer.revision);
  if (answer.component) WriteComponent(*answer.component, out->mutable_component());
  if (answer.geo_anchor) ToProto(*answer.geo_anchor, out->mutable_geo_anchor());
  out->set_geo_anchor_changed(answer.geo_anchor_changed);
}

absl::StatusOr<api::AlignAnswer> FromProto(const v1::AlignMapResponse& message) {
  api::AlignAnswer answer;
  answer.revision = message.revision();
  if (message.has_component()) {
    CAIRN_ASSIGN_OR_RETURN(answer.component, ReadComponent(message.component()));
  }
  if (message.has_geo_anchor()) {
    CAIRN_ASSIGN_OR_RETURN(answer.geo_anchor, FromProto(message.geo_anchor()));
  }
  answer.geo_anchor_changed = message.geo_anchor_changed();
  return answer;
}

}  // namespace cairn::wire

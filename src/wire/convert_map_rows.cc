#include "wire/convert_map_rows.h"

#include "wire/convert.h"
#include "wire/convert_alignment.h"
#include "wire/reading.h"
#include "wire/session_names.h"
#include "wire/text.h"

namespace cairn::wire {
namespace {

void WriteJoin(const map::ComponentJoin& join, v1::JoinRow* out) {
  out->set_into(join.into.value());
  ToProto(join.into_from_component, out->mutable_into_from_component());
  out->set_keyframe(join.keyframe.value());
  out->set_into_keyframe(join.into_keyframe.value());
  out->set_keyframe_time_ns(join.keyframe_time_ns);
  out->set_matches(join.matches);
  out->set_keyframes_agreeing(join.keyframes_agreeing);
  out->set_keyframes_checked(join.keyframes_checked);
  out->set_revision(join.revision);
  out->set_joined_unix_ns(join.joined_unix_ns);
}

absl::StatusOr<map::ComponentJoin> ReadJoin(const v1::JoinRow& message) {
  map::ComponentJoin join;
  join.into = ComponentId(message.into());
  CAIRN_ASSIGN_OR_RETURN(join.into_from_component, FromProto(message.into_from_component()));
  join.keyframe = KeyframeId(message.keyframe());
  join.into_keyframe = KeyframeId(message.into_keyframe());
  join.keyframe_time_ns = message.keyframe_time_ns();
  join.matches = message.matches();
  join.keyframes_agreeing = message.keyframes_agreeing();
  join.keyframes_checked = message.keyframes_checked();
  join.revision = message.revision();
  join.joined_unix_ns = message.joined_unix_ns();
  return join;
}

void WriteLoop(const map::ClosedLoop& loop, v1::LoopRow* out) {
  out->set_keyframe(loop.keyframe.value());
  out->set_keyframe_time_ns(loop.keyframe_time_ns);
  out->set_loop_keyframe(loop.loop_keyframe.value());
  out->set_loop_time_ns(loop.loop_time_ns);
  out->set_matches(loop.matches);
  out->set_scale(loop.scale);
  out->set_shift(loop.shift);
  out->set_turn_rad(loop.turn_rad);
  out->set_way(loop.way);
}

map::ClosedLoop ReadLoop(const v1::LoopRow& message) {
  map::ClosedLoop loop;
  loop.keyframe = KeyframeId(message.keyframe());
  loop.keyframe_time_ns = message.keyframe_time_ns();
  loop.loop_keyframe = KeyframeId(message.loop_keyframe());
  loop.loop_time_ns = message.loop_time_ns();
  loop.matches = message.matches();
  loop.scale = message.scale();
  loop.shift = message.shift();
  loop.turn_rad = message.turn_rad();
  loop.way = message.way();
  return loop;
}

}  // namespace

void ToProto(const map::RegionQuery& region, v1::MapRegion* out) {
  for (const KeyframeId id : region.around) out->add_around(id.value());
  out->set_component(region.component.value());
  Write(region.center, out->mutable_center());
  out->set_max_keyframes(region.max_keyframes);
}

absl::StatusOr<map::RegionQuery> FromProto(const v1::MapRegion& message) {
  constexpr int kMaxKeyframes = 100'000;
  map::RegionQuery region;
  for (const std::uint32_t id : message.around()) region.around.emplace_back(id);
  region.component = ComponentId(message.component());
  CAIRN_ASSIGN_OR_RETURN(region.center, Read(message.center()));
  region.max_keyframes = message.max_keyframes();
  if (region.max_keyframes < 1 || region.max_keyframes > kMaxKeyframes) {
    return absl::InvalidArgumentError(absl::StrCat("region: max_keyframes must be 1 to ", kMaxKeyframes));
  }
  return region;
}

void ToProto(const map::MapInfo& info, v1::MapHead* out) {
  out->set_id(info.id);
  out->set_title(Utf8(info.name));
  out->set_software_version(Utf8(info.software_version));
  out->set_created_unix_ns(info.created_unix_ns);
  out->set_orb_features(info.orb.num_features);
  out->set_orb_levels(info.orb.num_levels);
  out->set_orb_scale_factor(info.orb.scale_factor);
  out->set_orb_fast_threshold(info.orb.fast_threshold);
  out->set_orb_min_fast_threshold(info.orb.min_fast_threshold);
  out->set_vocabulary_hash(info.vocabulary_hash);
  if (info.geo_anchor) ToProto(*info.geo_anchor, out->mutable_geo_anchor());
}

absl::StatusOr<map::MapInfo> FromProto(const v1::MapHead& message) {
  map::MapInfo info;
  info.id = message.id();
  info.name = message.title();
  info.software_version = message.software_version();
  info.created_unix_ns = message.created_unix_ns();
  info.orb.num_features = message.orb_features();
  info.orb.num_levels = message.orb_levels();
  info.orb.scale_factor = message.orb_scale_factor();
  info.orb.fast_threshold = message.orb_fast_threshold();
  info.orb.min_fast_threshold = message.orb_min_fast_threshold();
  CAIRN_RETURN_IF_ERROR(info.orb.Validate());
  info.vocabulary_hash = message.vocabulary_hash();
  if (!message.has_geo_anchor()) return info;
  CAIRN_ASSIGN_OR_RETURN(info.geo_anchor, FromProto(message.geo_anchor()));
  return info;
}

void ToProto(const map::MapCamera& camera, v1::CameraRow* out) {
  out->set_id(camera.id.value());
  out->set_name(Utf8(camera.name));
  ToProto(camera.model, out->mutable_model());
  ToProto(Camera::FromPinhole(camera.pinhole), out->mutable_pinhole());
  if (!camera.lens) return;
  out->mutable_lens()->set_focal_scale(camera.lens->focal_scale);
  out->mutable_lens()->set_k1(camera.lens->k1);
  out->mutable_lens()->set_k2(camera.lens->k2);
}

absl::StatusOr<map::MapCamera> FromProto(const v1::CameraRow& message) {
  map::MapCamera camera;
  camera.id = CameraId(message.id());
  camera.name = message.name();
  CAIRN_ASSIGN_OR_RETURN(camera.model, FromProto(message.model()));
  CAIRN_ASSIGN_OR_RETURN(const Camera pinhole, FromProto(message.pinhole()));
  if (pinhole.model != CameraModel::kPinhole) return absl::InvalidArgumentError("pinhole: it must have no distortion");
  camera.pinhole = {pinhole.width_px, pinhole.height_px, pinhole.fx_px, pinhole.fy_px, pinhole.cx_px, pinhole.cy_px};
  if (message.has_lens()) {
    camera.lens = LensCorrection{message.lens().focal_scale(), message.lens().k1(), message.lens().k2()};
    CAIRN_RETURN_IF_ERROR(camera.lens->Validate());
  }
  return camera;
}

void ToProto(const map::Session& session, v1::SessionRow* out) {
  Write(session, out->mutable_info());
  out->set_settings_json(Utf8(session.settings_json));
  for (const map::ClosedLoop& loop : session.loops) WriteLoop(loop, out->add_loops());
  if (!session.trajectory) return;
  v1::TrajectoryRow* trajectory = out->mutable_trajectory();
  trajectory->set_refined(session.trajectory->refined);
  trajectory->set_keyframes(session.trajectory->keyframes);
  trajectory->set_collinear(session.trajectory->collinear);
  trajectory->set_reason(session.trajectory->reason);
}

map::Session FromProto(const v1::SessionRow& message) {
  map::Session session = Read(message.info());
  session.settings_json = message.settings_json();
  for (const v1::LoopRow& loop : message.loops()) session.loops.push_back(ReadLoop(loop));
  if (message.has_trajectory()) {
    const v1::TrajectoryRow& row = message.trajectory();
    session.trajectory = map::ReportedTrajectory{row.refined(), row.keyframes(), row.collinear(), row.reason()};
  }
  return session;
}

void ToProto(const map::Component& component, v1::ComponentRow* out) {
  out->set_id(component.id.value());
  out->set_session(component.session.value());
  if (component.world_from_component) ToProto(*component.world_from_component, out->mutable_world_from_component());
  if (component.joined) WriteJoin(*component.joined, out->mutable_joined());
}

absl::StatusOr<map::Component> FromProto(const v1::ComponentRow& message) {
  map::Component component;
  component.id = ComponentId(message.id());
  component.session = SessionId(message.session());
  if (message.has_world_from_component()) {
    CAIRN_ASSIGN_OR_RETURN(component.world_from_component, FromProto(message.world_from_component()));
  }
  if (message.has_joined()) {
    CAIRN_ASSIGN_OR_RETURN(component.joined, ReadJoin(message.joined()));
  }
  return component;
}

}  // namespace cairn::wire

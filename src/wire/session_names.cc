#include "wire/session_names.h"

#include "wire/text.h"

namespace cairn::wire {

v1::SessionInfo::Policy Write(map::SessionPolicy policy) {
  return policy == map::SessionPolicy::kCreate ? v1::SessionInfo::POLICY_CREATE : v1::SessionInfo::POLICY_EXTEND;
}

v1::SessionInfo::Result Write(map::SessionResult result) {
  switch (result) {
    case map::SessionResult::kUnknown:
      return v1::SessionInfo::RESULT_UNSPECIFIED;
    case map::SessionResult::kCreated:
      return v1::SessionInfo::RESULT_CREATED;
    case map::SessionResult::kLocated:
      return v1::SessionInfo::RESULT_LOCATED;
    case map::SessionResult::kApart:
      return v1::SessionInfo::RESULT_APART;
  }
  return v1::SessionInfo::RESULT_UNSPECIFIED;
}

map::SessionResult ReadResult(v1::SessionInfo::Result result) {
  switch (result) {
    case v1::SessionInfo::RESULT_CREATED:
      return map::SessionResult::kCreated;
    case v1::SessionInfo::RESULT_LOCATED:
      return map::SessionResult::kLocated;
    case v1::SessionInfo::RESULT_APART:
      return map::SessionResult::kApart;
    default:
      return map::SessionResult::kUnknown;
  }
}

void Write(const map::Session& session, v1::SessionInfo* out) {
  out->set_id(session.id.value());
  out->set_camera(session.camera.value());
  out->set_source(Utf8(session.source));
  out->set_software_version(Utf8(session.software_version));
  out->set_first_ns(session.first_ns);
  out->set_last_ns(session.last_ns);
  out->set_started_unix_ns(session.started_unix_ns);
  out->set_ended_unix_ns(session.ended_unix_ns);
  out->set_complete(session.complete);
  out->set_removed(session.removed);
  out->set_policy(Write(session.policy));
  out->set_result(Write(session.result));
  for (const ComponentId component : session.components) out->add_components(component.value());
}

map::Session Read(const v1::SessionInfo& message) {
  map::Session session;
  session.id = SessionId(message.id());
  session.camera = CameraId(message.camera());
  session.source = message.source();
  session.software_version = message.software_version();
  session.first_ns = message.first_ns();
  session.last_ns = message.last_ns();
  session.started_unix_ns = message.started_unix_ns();
  session.ended_unix_ns = message.ended_unix_ns();
  session.complete = message.complete();
  session.removed = message.removed();
  session.policy =
      message.policy() == v1::SessionInfo::POLICY_EXTEND ? map::SessionPolicy::kExtend : map::SessionPolicy::kCreate;
  session.result = ReadResult(message.result());
  for (const std::uint32_t component : message.components()) session.components.emplace_back(component);
  return session;
}

v1::FrameAnswer::State Write(api::SessionState state) {
  switch (state) {
    case api::SessionState::kInitializing:
      return v1::FrameAnswer::STATE_INITIALIZING;
    case api::SessionState::kGood:
      return v1::FrameAnswer::STATE_GOOD;
    case api::SessionState::kPoor:
      return v1::FrameAnswer::STATE_POOR;
    case api::SessionState::kLost:
      return v1::FrameAnswer::STATE_LOST;
  }
  return v1::FrameAnswer::STATE_UNSPECIFIED;
}

api::SessionState ReadState(v1::FrameAnswer::State state) {
  switch (state) {
    case v1::FrameAnswer::STATE_INITIALIZING:
      return api::SessionState::kInitializing;
    case v1::FrameAnswer::STATE_GOOD:
      return api::SessionState::kGood;
    case v1::FrameAnswer::STATE_POOR:
      return api::SessionState::kPoor;
    default:
      return api::SessionState::kLost;
  }
}

}  // namespace cairn::wire

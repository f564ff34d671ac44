#include "wire/session_names.h"

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

}  // namespace cairn::wire

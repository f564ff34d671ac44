#include "api/map_session.h"

namespace cairn::api {

const char* SessionStateName(SessionState state) {
  switch (state) {
    case SessionState::kInitializing:
      return "initializing";
    case SessionState::kGood:
      return "good";
    case SessionState::kPoor:
      return "poor";
    case SessionState::kLost:
      return "lost";
  }
  return "unknown";
}

}  // namespace cairn::api

#include "api/tracker.h"

namespace cairn::api {

const char* TrackStateName(TrackState state) {
  switch (state) {
    case TrackState::kLocated:
      return "located";
    case TrackState::kTracked:
      return "tracked";
    case TrackState::kCarried:
      return "carried";
    case TrackState::kLost:
      return "lost";
  }
  return "unknown";
}

}  // namespace cairn::api

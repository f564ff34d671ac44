// A session that is running, as those see it who watch.
#pragma once

#include <cstdint>
#include <string>

#include "api/map_session.h"

namespace cairn::api {

struct ActiveSession {
  std::string map;
  std::string source;                                // name of the sequence or the robot
  bool waiting = false;                              // for its client, which was cut off
  double running_s = 0.0;                            // since it was started
  double silent_s = 0.0;                             // since its last frame was answered, or it was started
  std::int64_t frames = 0;                           // answered
  SessionState state = SessionState::kInitializing;  // of the last one
  SessionProgress progress;
};

}  // namespace cairn::api

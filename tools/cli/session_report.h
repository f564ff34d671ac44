// What a session says about its loops and its trajectory, for `cairn run` and `cairn info`.
#pragma once

#include "cli/cli.h"
#include "map/entities.h"

namespace cairn::cli {

// One object per loop: which keyframes and when (seconds from the start of the session), matches that agree, and the
// size of the correction (shift and way in map units).
nlohmann::ordered_json LoopsAsJson(const map::Session& session);
// Null if the session has not ended, or had no choice.
nlohmann::ordered_json TrajectoryAsJson(const map::Session& session);

// The same for people, each line after `indent`.
void PrintLoopsAndTrajectory(const map::Session& session, const char* indent);

}  // namespace cairn::cli

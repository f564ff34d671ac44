// What a session says about its loops and its trajectory, for `cairn run` and `cairn info`.
#pragma once

#include "cli/cli.h"
#include "map/entities.h"
#include "mapping/lens_refinement.h"

namespace cairn::cli {

// One object per loop: which keyframes and when (seconds from the start of the session), matches that agree, and the
// size of the correction (shift and way in map units).
nlohmann::ordered_json LoopsAsJson(const map::Session& session);
// Null if the session has not ended, or had no choice.
nlohmann::ordered_json TrajectoryAsJson(const map::Session& session);

// Options that differ from the defaults; null if that is not known.
nlohmann::ordered_json SettingsAsJson(const map::Session& session);

// What a session found out about its camera's lens (mapping/lens_refinement.h); null if it did not ask.
nlohmann::ordered_json LensAsJson(const std::optional<mapping::LensReport>& lens);
// What the map knows of it: null without a correction.
nlohmann::ordered_json LensAsJson(const map::MapCamera& camera);

// The same for people, each line after `indent`.
void PrintLoopsAndTrajectory(const map::Session& session, const char* indent);

}  // namespace cairn::cli

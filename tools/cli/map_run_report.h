// What `cairn run --map` tells at the end of a session: as one JSON object, or for people.
#pragma once

#include <cstdint>
#include <optional>

#include "cli/interrupt.h"
#include "cli/run_feed.h"
#include "cli/run_options.h"
#include "engine/session_report.h"
#include "io/frame_source.h"
#include "map/snapshot.h"

namespace cairn::cli {

// That the files are about: the component with most frames of this session.
ComponentId ComponentOfFiles(const engine::SessionReport& report);

// `live_poses`: how many were written while the session went on, if that was asked for.
void PrintMapRunReport(const RunOptions& options, const engine::SessionReport& report, const map::Snapshot& map,
                       const io::SourceInfo& info, const FeedReport& feed, const InterruptWatch& interrupt,
                       std::optional<std::int64_t> live_poses);

}  // namespace cairn::cli

// How sure the poses of a run are, as a file.
#include "absl/strings/str_format.h"
#include "base/angles.h"
#include "base/files.h"
#include "cli/map_run_report.h"
#include "cli/run_options.h"

namespace cairn::cli {

absl::Status WriteQuality(const RunOptions& options, const engine::SessionReport& report, const map::Snapshot& map) {
  if (options.quality.empty()) return absl::OkStatus();
  const ComponentId component = ComponentOfFiles(report);
  const std::optional<Sim3>& world_from_map = map.WorldFrom(component);
  const double scale = world_from_map ? world_from_map->scale() : 1.0;
  std::string text = absl::StrCat("t,quality,sigma_position,sigma_rotation_deg\n");
  for (const engine::FramePose& frame : report.frame_poses) {
    if (!frame.map_from_camera || frame.component != component) continue;
    absl::StrAppendFormat(&text, "%.9f,%.3f,%.9g,%.6g\n", ToSeconds(frame.time_ns), frame.quality,
                          scale * frame.sigma.position, frame.sigma.rotation_rad * kDegPerRad);
  }
  return WriteFileAtomically(options.quality, text, options.overwrite);
}

}  // namespace cairn::cli

// What the ways of `cairn run` share: its options, and the loop over a sequence's images. Each way is a file of its
// own: run_map.cc (a sequence into a map), run_stills.cc (stills with known poses), run_odometry.cc (poses only).
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/status.h"
#include "cli/cli.h"
#include "cli/input_options.h"
#include "engine/frame_preparation.h"
#include "engine/map_writer.h"
#include "engine/session.h"
#include "io/frame_source.h"
#include "mapping/posed_mapper.h"
#include "place/vocabulary.h"

namespace cairn::cli {

struct RunOptions {
  InputOptions input;
  std::string map;
  std::string name;
  std::string trajectory;
  std::string keyframes;
  std::string poses;
  std::string vocabulary;
  std::string picture;
  engine::SessionOptions session;
  mapping::PosedMapperOptions posed;
  bool odometry_only = false;
  bool overwrite = false;
  bool json = false;
};

absl::Status MapSequence(const RunOptions& options);
absl::Status MapStills(const RunOptions& options);
absl::Status TrackSequence(const RunOptions& options);

// Everything that a run into a map needs besides the session.
struct MapRun {
  std::unique_ptr<io::FrameSource> source;
  place::Vocabulary vocabulary;
  std::unique_ptr<engine::MapWriter> writer;
  engine::SessionSource session_source;
};
absl::StatusOr<MapRun> PrepareMapRun(const RunOptions& options);

// The files that a run into a map leaves beside it.
absl::Status WriteMapOutputs(const RunOptions& options, const map::Snapshot& map,
                             const std::vector<std::pair<TimeNs, SE3>>& frame_poses);
// Of all keyframes, map_from_camera in temporal order.
std::vector<std::pair<TimeNs, SE3>> MapKeyframePoses(const map::Snapshot& map);

// The stream that a session is told of.
engine::SessionSource ToSessionSource(const io::SourceInfo& info);
engine::RawFrame ToRaw(const io::SourceFrame& frame);

// From files to frames: reads, skips what is damaged, shows the progress. `handle` returns the note behind the bar.
template <class Handle>
absl::Status ForEachFrame(io::FrameSource& source, SkippedFrames* skipped, Progress* progress, const Handle& handle) {
  for (;;) {
    CAIRN_ASSIGN_OR_RETURN(std::optional<io::SourceFrame> frame, source.Next());
    if (!frame) return absl::OkStatus();
    if (!frame->status.ok()) {
      skipped->Add(frame->path, frame->status);
      continue;
    }
    CAIRN_ASSIGN_OR_RETURN(const std::string note, handle(*frame));
    progress->Update(frame->index + 1, note);
  }
}

}  // namespace cairn::cli

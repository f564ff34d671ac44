// What those who keep maps ask of them: copies, the trash, checks, history, files.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "base/ids.h"
#include "base/status.h"
#include "map/history.h"

namespace cairn::api {

// A map in the trash.
struct DeletedMap {
  std::string deleted;  // by which it is restored
  std::string map;      // its name when it was deleted
  std::int64_t deleted_unix_ns = 0;
  std::int64_t file_bytes = 0;
};

// The name that a deleted map had: `deleted` is NAME.MILLISECONDS, by when it was deleted (since 1970).
struct DeletedName {
  std::string map;
  std::int64_t deleted_ms = 0;
};
// InvalidArgument for what no deleted map is called.
absl::StatusOr<DeletedName> ParseDeletedName(const std::string& deleted);

// How deep a check goes: whether everything is as it was written, or also whether it makes sense (geometry, words).
enum class VerifyDepth { kStored, kDeep };

struct MapLog {
  Revision revision = 0;                   // of the map
  std::vector<map::LoggedChange> changes;  // the newest first
};

// What became of a map of which a session was taken out.
struct SessionRemoval {
  Revision revision = 0;  // that it led to
  SessionId session;
  std::int64_t keyframes = 0;                   // that are gone: the session's ...
  std::int64_t points = 0;                      // ... and those that nobody else sees
  std::vector<ComponentId> removed_components;  // that were the session's alone
  std::int64_t adjusted_keyframes = 0;          // of the others, in components that it was part of
  double adjustment_rmse_px = 0.0;              // of what they see, after that
  double median_move_share = 0.0;               // by which that moved them, of the median depth of what they see
};

// What can be made from a map. All but kMap: of all aligned components in the world frame, in metres; while none is
// aligned, of the largest one in its own frame and unit.
enum class ExportContent {
  kMap,         // a map file, whole and by itself
  kTrajectory,  // poses of the keyframes, TUM format
  kPoints,      // the points, a binary PLY file
};

// Takes a file in parts; an error ends the export.
using ExportSink = std::function<absl::Status(absl::string_view part)>;

}  // namespace cairn::api

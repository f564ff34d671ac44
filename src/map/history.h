// What is told of a map's past and of its health, wherever it is kept.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/ids.h"
#include "map/delta.h"

namespace cairn::map {

// One line of the log of changes; the newest kMaxLoggedChanges are kept.
struct LoggedChange {
  Revision revision = 0;  // after the change
  std::string reason;
  SessionId session;                    // that made it; none: somebody else, or made by a format before 4
  std::int64_t committed_unix_ns = 0;   // 0: not recorded
  std::vector<ComponentId> components;  // whose keyframes, points or own row it put or removed, ascending
  // What it put (added or replaced) and removed.
  std::int64_t keyframes_put = 0;
  std::int64_t keyframes_removed = 0;
  std::int64_t points_put = 0;
  std::int64_t points_removed = 0;
  std::int64_t cameras_put = 0;
  std::int64_t cameras_removed = 0;
  std::int64_t sessions_put = 0;
  std::int64_t components_put = 0;
  std::int64_t components_removed = 0;
  bool info_put = false;
  bool operator==(const LoggedChange&) const = default;
};
inline constexpr int kMaxLoggedChanges = 1000;

// Which of them: those that fit all that is said.
struct ChangeQuery {
  Revision from_revision = 0;  // those that made this revision and later ones
  SessionId session;           // none: whoever made them
  int max_count = kMaxLoggedChanges;
};

// Something wrong with a map.
struct Finding {
  std::string table;    // empty: the map as a whole
  std::int64_t id = 0;  // of the row; 0: the table as a whole
  std::string message;
};

}  // namespace cairn::map

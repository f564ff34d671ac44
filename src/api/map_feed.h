// Following a map that somebody keeps: from what the follower has to what is there, and then on, step by step. For
// those who send it elsewhere; who follows it there has its own copy.
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/ids.h"
#include "base/status.h"
#include "map/changed_rows.h"
#include "map/region.h"
#include "map/snapshot.h"

namespace cairn::api {

struct FollowRequest {
  std::string map_id;                                     // of what the follower has; empty: it has nothing
  Revision revision = 0;                                  // that it has
  std::optional<map::RegionQuery> region = std::nullopt;  // none: the whole map
  std::vector<KeyframeId> held = {};                      // of a region that the follower has, ascending
  // From one step to the next: what changes meanwhile comes as one.
  std::chrono::milliseconds min_interval{0};
};

struct MapStep {
  std::shared_ptr<const map::Snapshot> map;
  map::ChangedRows rows;                        // that lead there from the step before, or from what the follower had
  std::optional<std::vector<KeyframeId>> only;  // of a region, its keyframes, ascending
};

// By one thread at a time.
class MapFeed {
 public:
  virtual ~MapFeed() = default;

  // The first step comes at once, also if nothing has changed; each of the others waits for a change, at most so long.
  // Nothing: there was none. Nothing is queued for who does not ask. Errors as of MapService::Describe(); what is asked
  // afterwards may succeed again.
  virtual absl::StatusOr<std::optional<MapStep>> Next(std::chrono::milliseconds timeout) = 0;

  // Of the map of the last step, serialized; empty: it has none.
  virtual std::string Vocabulary() const = 0;
};

}  // namespace cairn::api

// Where a session is in the map: in a component of its own, or found in an earlier one. Noted by the thread of the
// feature module, asked for by any.
#pragma once

#include <mutex>
#include <optional>
#include <vector>

#include "base/ids.h"
#include "base/time.h"
#include "map/snapshot.h"
#include "mapping/component_join.h"

namespace cairn::engine {

// When and where a session was found in what was there before.
struct LocatedAt {
  TimeNs time_ns = 0;     // of the image that was found
  ComponentId component;  // as it was named then
};

struct Whereabouts {
  ComponentId component;  // none before the first keyframe
  // As soon as an image was found in a component that was there before, proven or not.
  std::optional<LocatedAt> located;
  std::optional<TimeNs> joined_ns;  // and proven: of the keyframe that did
};

class WhereaboutsNotes {
 public:
  explicit WhereaboutsNotes(SessionId session) : session_(session) {}

  Whereabouts Now() const;

  // The rest by the thread of the feature module; `map` as it is now.
  void IsIn(ComponentId component);
  // An image was found in this component: worth a note if others have made it.
  void Saw(TimeNs time_ns, ComponentId component, const map::Snapshot& map);
  // Two components have become one by the keyframe of this time; `own`: the one that the session is in since.
  void Joined(TimeNs time_ns, const mapping::JoinReport& join, ComponentId own, const map::Snapshot& map);
  // Of all joins, in order.
  const std::vector<TimeNs>& join_times_ns() const { return join_times_ns_; }

 private:
  bool IsOwn(ComponentId component, const map::Snapshot& map) const;

  const SessionId session_;
  std::vector<TimeNs> join_times_ns_;

  mutable std::mutex mutex_;
  Whereabouts now_;
};

}  // namespace cairn::engine

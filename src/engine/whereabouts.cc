#include "engine/whereabouts.h"

namespace cairn::engine {

bool WhereaboutsNotes::IsOwn(ComponentId component, const map::Snapshot& map) const {
  return map.component(component).session == session_;
}

Whereabouts WhereaboutsNotes::Now() const {
  const std::lock_guard lock(mutex_);
  return now_;
}

void WhereaboutsNotes::IsIn(ComponentId component) {
  const std::lock_guard lock(mutex_);
  now_.component = component;
}

void WhereaboutsNotes::Saw(TimeNs time_ns, ComponentId component, const map::Snapshot& map) {
  const std::lock_guard lock(mutex_);
  if (now_.located || IsOwn(component, map)) return;
  now_.located = LocatedAt{time_ns, component};
}

void WhereaboutsNotes::Joined(TimeNs time_ns, const mapping::JoinReport& join, ComponentId own,
                              const map::Snapshot& map) {
  join_times_ns_.push_back(time_ns);
  if (IsOwn(join.into, map) && IsOwn(join.component, map)) return;
  Saw(time_ns, join.into == own ? join.seen_in : join.into, map);
  const std::lock_guard lock(mutex_);
  if (!now_.joined_ns) now_.joined_ns = time_ns;
}

}  // namespace cairn::engine

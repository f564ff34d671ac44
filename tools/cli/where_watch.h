// Says on the terminal where a session is in the map that it extends, as soon as that is known, and what it is sure of.
#pragma once

#include <string>

#include "base/time.h"
#include "engine/session.h"

namespace cairn::cli {

class WhereWatch {
 public:
  // `first_ns`: the start of the session, from which seconds are counted. `session` must outlive it.
  WhereWatch(const engine::Session& session, TimeNs first_ns, bool quiet)
      : session_(session), first_ns_(first_ns), quiet_(quiet) {}

  // After each frame.
  void Look();

 private:
  static void Say(const std::string& text);

  const engine::Session& session_;
  const TimeNs first_ns_;
  const bool quiet_;
  bool seen_ = false, joined_ = false;
};

}  // namespace cairn::cli

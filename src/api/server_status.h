// How a server is doing, for those who watch it. Counts grow from its start: rates are differences of two answers.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "api/active_session.h"
#include "base/ids.h"

namespace cairn::api {

// How often something took how long.
struct DurationHistogram {
  std::vector<double> bounds_s;      // upper bounds of the buckets, ascending
  std::vector<std::int64_t> counts;  // in each; one more than bounds, for what took longer
  double sum_s = 0.0;

  std::int64_t total() const;
  // Below which this share of all lies, interpolated in its bucket; 0 without any. What took longer than the last
  // bound counts as that.
  double Quantile(double share) const;
  // What came after `before`, an earlier state of the same histogram.
  DurationHistogram Since(const DurationHistogram& before) const;
};

struct ServerStatus {
  struct Map {
    std::string name;
    Revision revision = 0;
    std::int64_t memory_bytes = 0;  // roughly
    bool writing = false;           // sessions are extending it
  };
  struct Count {
    std::string what;
    std::int64_t count = 0;
  };
  struct Calls {
    std::string call;    // "Maps.ListMaps"
    std::string reason;  // how it came out: "ok", or a reason of docs/server.md
    std::int64_t count = 0;
  };

  std::string version;
  double uptime_s = 0.0;
  std::int64_t resident_bytes = 0;  // of the process
  std::int64_t images_waiting = 0;  // that are to be located
  int followers = 0;                // clients that keep a copy of a map
  std::vector<Map> maps;            // in memory, by name
  std::vector<ActiveSession> sessions;
  std::vector<Calls> calls;
  std::vector<Count> localized;       // images, by "located" or the stage at which they were missed
  std::vector<Count> tracked;         // frames that are only tracked, by what came of them
  std::vector<Count> session_frames;  // frames of sessions, likewise
  DurationHistogram localize;         // calls that locate an image, from the call to its answer
  DurationHistogram tracking;
  DurationHistogram session_frame;
};

}  // namespace cairn::api

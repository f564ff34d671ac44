// What a session counts and times, in bounded memory.
#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "base/sample_reservoir.h"
#include "engine/loop_runner.h"
#include "engine/odometry_runner.h"
#include "engine/session_report.h"
#include "map/snapshot.h"
#include "mapping/feature_mapper.h"

namespace cairn::engine {

class SessionStatistics {
 public:
  // One packet through the feature module.
  void Add(const mapping::KeyframeReport& report);
  // Of the keyframes so far, none of which started the map: what the one with the most to start from says.
  std::string WhyNoMap() const;
  // What belongs into the report of the session.
  void Fill(const LoopRunner& loops, const OdometryRunner& runner, SessionReport* report) const;

 private:
  static constexpr std::size_t kRecentKeyframes = 65536;

  SampleReservoir keyframe_ms_;
  std::deque<mapping::KeyframeReport> keyframe_reports_;  // the last of them
  std::int64_t feature_losses_ = 0;
  bool feature_lost_ = false;
};

// Of the components of a map, each with what a session has in it, ascending.
std::vector<ComponentShare> SharesOf(const map::Snapshot& map, const std::vector<FramePose>& frames);

}  // namespace cairn::engine

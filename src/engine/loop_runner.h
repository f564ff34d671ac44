// What a session does for the map as a whole: after each keyframe of the feature module the search for another
// component that it sees, and for a loop within its own; after either the bundle adjustment of the component, in a
// thread of its own or, in deterministic mode, at once. The adjustment reads a snapshot, is cut short by the next loop
// or join, and is merged into what the map has become meanwhile: a large one in parts, one after each keyframe and
// more while there is none, so that others who change the map get their turns. Every change goes through the head of
// the map.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "base/sample_reservoir.h"
#include "base/status.h"
#include "mapping/component_join.h"
#include "mapping/feature_mapper.h"
#include "mapping/full_adjustment.h"
#include "mapping/loop_closer.h"
#include "mapping/map_head.h"

namespace cairn::engine {

struct LoopRunnerOptions {
  mapping::LoopOptions loops;
  mapping::JoinOptions joins;
  bool close_loops = true;    // false: components are joined alone
  bool in_background = true;  // adjustments in a thread of their own
  bool record_wall_clock = true;
  std::size_t points_per_part = mapping::AdjustmentMerge::kPointsPerPart;  // of an adjustment that is merged
};

class LoopRunner {
 public:
  static absl::StatusOr<std::unique_ptr<LoopRunner>> Create(const LoopRunnerOptions& options);
  ~LoopRunner();
  LoopRunner(const LoopRunner&) = delete;
  LoopRunner& operator=(const LoopRunner&) = delete;

  // All that follow in the mapping thread, while the head is the caller's.

  // After each packet. Does nothing in a map without a vocabulary.
  absl::Status AfterPacket(const mapping::KeyframeReport& packet, mapping::MapHead& head);
  // Whether the last keyframe was seen in another component, and that it is there is not proven.
  bool ExpectsJoin() const { return expects_join_; }
  // Merges a part of the adjustment, if it is done. True if more of it waits to be merged.
  absl::StatusOr<bool> MergePart(mapping::MapHead& head);
  // At the end of the stream, when AfterPacket() is not called any more: waits for the adjustment, which MergePart()
  // then merges. The head need not be the caller's.
  void WaitForAdjustment();
  // Lengths of the map have changed, by whomever: an adjustment under way is about a map that is no more.
  void OnCorrection() { stale_ = stop_ = true; }

  // While something was corrected: after a loop or a join, and the adjustments with their merging. The last of them.
  struct Span {
    std::chrono::steady_clock::time_point begin, end;
  };
  static constexpr std::size_t kRecentSpans = 1024;
  const std::deque<Span>& corrections() const { return corrections_; }
  const std::deque<Span>& adjustments() const { return adjustments_; }

  // Loops closed and components joined, in order.
  const std::vector<mapping::LoopReport>& loops() const { return loops_; }
  const std::vector<mapping::JoinReport>& joins() const { return joins_; }
  // Candidates that were no loops, and keyframes found in another component that proved no overlap, by the reason.
  const std::map<std::string, int>& rejected() const { return rejected_; }
  const std::map<std::string, int>& joins_rejected() const { return joins_rejected_; }
  // Time of every search, in milliseconds.
  const SampleReservoir& search_ms() const { return search_ms_; }

 private:
  LoopRunner(const LoopRunnerOptions& options, mapping::LoopCloser closer, mapping::ComponentJoiner joiner)
      : options_(options), closer_(std::move(closer)), joiner_(std::move(joiner)) {}

  using Clock = std::chrono::steady_clock;
  absl::StatusOr<bool> Join(KeyframeId keyframe, mapping::MapHead& head);
  absl::StatusOr<bool> CloseLoop(KeyframeId keyframe, mapping::MapHead& head);
  absl::Status StartAdjustment(KeyframeId keyframe, mapping::MapHead& head);
  void Compute(std::shared_ptr<const map::Snapshot> map, ComponentId component);
  void Done(absl::StatusOr<mapping::FullAdjustment> adjustment);
  void DropAdjustment();

  const LoopRunnerOptions options_;
  mapping::LoopCloser closer_;
  mapping::ComponentJoiner joiner_;
  std::vector<mapping::LoopReport> loops_;
  std::vector<mapping::JoinReport> joins_;
  bool expects_join_ = false;
  std::map<std::string, int> rejected_, joins_rejected_;
  SampleReservoir search_ms_;
  std::deque<Span> corrections_;
  std::deque<Span> adjustments_;

  std::thread thread_;
  SessionId session_;  // whose adjustment it is
  std::atomic<bool> stop_ = false;
  bool stale_ = false;
  std::atomic<bool> done_ = false;  // adjustment_ is there and belongs to the mapping thread
  std::optional<absl::StatusOr<mapping::FullAdjustment>> adjustment_;  // the thread's until then
  std::optional<mapping::AdjustmentMerge> merge_;                      // of what is left of it
  int parts_merged_ = 0;
};

}  // namespace cairn::engine

// Loop closing within a session: after each keyframe of the feature module the search for a loop, and after a loop the
// bundle adjustment of the whole map, in a thread of its own or, in deterministic mode, at once. The adjustment reads a
// snapshot, is cut short by the next loop, and is merged into what the map has become meanwhile. Every change goes
// through the feature module, so there is one writer still.
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
#include "mapping/feature_mapper.h"
#include "mapping/full_adjustment.h"
#include "mapping/loop_closer.h"

namespace cairn::engine {

class LoopRunner {
 public:
  static absl::StatusOr<std::unique_ptr<LoopRunner>> Create(const mapping::LoopOptions& options, bool in_background);
  ~LoopRunner();
  LoopRunner(const LoopRunner&) = delete;
  LoopRunner& operator=(const LoopRunner&) = delete;

  // In the mapping thread, after each packet. Does nothing without a vocabulary.
  absl::Status AfterPacket(const mapping::KeyframeReport& packet, mapping::FeatureMapper* mapper);
  // At the end of the stream: waits for the adjustment and merges it.
  absl::Status Finish(mapping::FeatureMapper* mapper);

  // While something was corrected: after a loop, and the adjustments of the whole map with their merging.
  struct Span {
    std::chrono::steady_clock::time_point begin, end;
  };
  // The last of them, kRecentSpans at most.
  static constexpr std::size_t kRecentSpans = 1024;
  const std::deque<Span>& corrections() const { return corrections_; }
  const std::deque<Span>& adjustments() const { return adjustments_; }

  // Loops closed, in order.
  const std::vector<mapping::LoopReport>& loops() const { return loops_; }
  // Candidates that were no loops, by the reason.
  const std::map<std::string, int>& rejected() const { return rejected_; }
  // Time of the searches, in milliseconds.
  const SampleReservoir& search_ms() const { return search_ms_; }

 private:
  LoopRunner(mapping::LoopCloser closer, bool in_background)
      : closer_(std::move(closer)), in_background_(in_background) {}

  absl::Status StartAdjustment(mapping::FeatureMapper* mapper);
  void Compute(std::shared_ptr<const map::Snapshot> map);
  void Done(absl::StatusOr<mapping::FullAdjustment> adjustment);
  absl::Status MergeIfDone(mapping::FeatureMapper* mapper);
  void Join();

  mapping::LoopCloser closer_;
  const bool in_background_;
  std::vector<mapping::LoopReport> loops_;
  std::map<std::string, int> rejected_;
  SampleReservoir search_ms_;
  std::deque<Span> corrections_;
  std::deque<Span> adjustments_;

  std::thread thread_;
  std::atomic<bool> stop_ = false;
  std::atomic<bool> done_ = false;  // adjustment_ is there and belongs to the mapping thread
  std::optional<absl::StatusOr<mapping::FullAdjustment>> adjustment_;  // the thread's until then
};

}  // namespace cairn::engine

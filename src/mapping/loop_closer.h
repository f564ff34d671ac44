// Loop closing, step by step for each keyframe that enters the map: detection (mapping/loop_detector.h), verification
// (mapping/loop_verification.h), correction as one Delta (mapping/loop_correction.h). The bundle adjustment of the
// whole map that should follow is a step of its own (mapping/full_adjustment.h), because it may take long.
//
// Owns no threads; call it from the mapping thread. Deterministic.
#pragma once

#include <functional>
#include <memory>

#include "base/status.h"
#include "map/delta.h"
#include "map/snapshot.h"
#include "mapping/loop_correction.h"
#include "mapping/loop_detector.h"
#include "mapping/loop_options.h"
#include "mapping/loop_verification.h"
#include "tracking/place_index.h"

namespace cairn::mapping {

struct LoopReport {
  bool closed = false;
  KeyframeId current;
  KeyframeId loop;        // if closed
  int candidates = 0;     // consistent ones, verified until one held
  LoopEvidence evidence;  // of the one that held, or of the last that did not
  LoopCorrection correction;
  double detect_ms = 0.0;
  double verify_ms = 0.0;
  double correct_ms = 0.0;
  double commit_ms = 0.0;
};

class LoopCloser {
 public:
  // Applies a change, tells everyone who keeps lengths of the map how these have changed, and returns the map after it.
  using Commit = std::function<absl::StatusOr<std::shared_ptr<const map::Snapshot>>(map::Delta delta,
                                                                                    const KeyframeScales& scales)>;

  // InvalidArgument for bad options.
  static absl::StatusOr<LoopCloser> Create(const LoopOptions& options = {});

  // To be called for each keyframe inserted, newest last. `places` must be of the revision of `map` (and may be brought
  // to the next one by `commit`); FailedPrecondition if not, NotFound if the map does not have the keyframe. A
  // correction that cannot be solved is not made.
  absl::StatusOr<LoopReport> Process(std::shared_ptr<const map::Snapshot> map, const tracking::PlaceIndex& places,
                                     KeyframeId keyframe, const Commit& commit);

  int loops_closed() const { return loops_closed_; }

 private:
  explicit LoopCloser(const LoopOptions& options) : options_(options), detector_(options) {}

  LoopOptions options_;
  LoopDetector detector_;
  LoopEdges edges_;  // made so far
  int loops_closed_ = 0;
};

}  // namespace cairn::mapping

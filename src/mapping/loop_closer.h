// Loop closing, step by step for each keyframe that enters the map: detection (mapping/loop_detector.h), verification
// (mapping/loop_verification.h), correction as one Delta (mapping/loop_correction.h). The bundle adjustment of the
// whole map that should follow is a step of its own (mapping/full_adjustment.h), because it may take long.
//
// Owns no threads; call it from the mapping thread. Deterministic.
#pragma once

#include "base/status.h"
#include "mapping/loop_correction.h"
#include "mapping/loop_detector.h"
#include "mapping/loop_options.h"
#include "mapping/loop_verification.h"
#include "mapping/map_head.h"

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
  // InvalidArgument for bad options.
  static absl::StatusOr<LoopCloser> Create(const LoopOptions& options = {});

  // To be called for each keyframe inserted, newest last, while the head is the caller's. FailedPrecondition without a
  // vocabulary, NotFound if the map does not have the keyframe. A correction that cannot be solved is not made.
  absl::StatusOr<LoopReport> Process(KeyframeId keyframe, MapHead& head);

  int loops_closed() const { return loops_closed_; }

 private:
  explicit LoopCloser(const LoopOptions& options) : options_(options), detector_(options) {}

  LoopOptions options_;
  LoopDetector detector_;
  LoopEdges edges_;  // made so far
  int loops_closed_ = 0;
};

}  // namespace cairn::mapping

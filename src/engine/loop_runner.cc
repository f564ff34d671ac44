#include "engine/loop_runner.h"

#include <utility>

#include "base/guarded.h"
#include "map/edit.h"

namespace cairn::engine {
namespace {

void Remember(const LoopRunner::Span& span, std::deque<LoopRunner::Span>* spans) {
  spans->push_back(span);
  if (spans->size() > LoopRunner::kRecentSpans) spans->pop_front();
}

}  // namespace

absl::StatusOr<std::unique_ptr<LoopRunner>> LoopRunner::Create(const mapping::LoopOptions& options,
                                                               bool in_background) {
  CAIRN_ASSIGN_OR_RETURN(mapping::LoopCloser closer, mapping::LoopCloser::Create(options));
  return std::unique_ptr<LoopRunner>(new LoopRunner(std::move(closer), in_background));
}

LoopRunner::~LoopRunner() {
  stop_ = true;
  Join();
}

void LoopRunner::Join() {
  if (thread_.joinable()) thread_.join();
}

absl::Status LoopRunner::AfterPacket(const mapping::KeyframeReport& packet, mapping::FeatureMapper* mapper) {
  CAIRN_RETURN_IF_ERROR(MergeIfDone(mapper));
  if (!packet.inserted || mapper->places() == nullptr) return absl::OkStatus();
  const auto commit = [mapper](map::Delta delta, const mapping::KeyframeScales& scales) {
    return mapper->CommitCorrection(std::move(delta), scales);
  };
  const auto begin = std::chrono::steady_clock::now();
  CAIRN_ASSIGN_OR_RETURN(mapping::LoopReport report,
                         closer_.Process(mapper->map(), *mapper->places(), packet.keyframe, commit));
  search_ms_.Add(static_cast<float>(report.detect_ms + report.verify_ms));
  if (report.candidates > 0 && !report.closed) ++rejected_[report.evidence.rejected];
  if (!report.closed) return absl::OkStatus();
  const std::chrono::duration<double, std::milli> searched(report.detect_ms + report.verify_ms);
  Remember({begin + std::chrono::duration_cast<std::chrono::steady_clock::duration>(searched),
            std::chrono::steady_clock::now()},
           &corrections_);
  loops_.push_back(std::move(report));
  return StartAdjustment(mapper);
}

absl::Status LoopRunner::StartAdjustment(mapping::FeatureMapper* mapper) {
  // One that is under way is about the map before this loop.
  stop_ = true;
  if (thread_.joinable()) adjustments_.back().end = std::chrono::steady_clock::now();
  Join();
  stop_ = false;
  done_ = false;
  adjustment_.reset();
  Remember({std::chrono::steady_clock::now(), std::chrono::steady_clock::time_point::max()}, &adjustments_);
  if (in_background_) {
    absl::StatusOr<std::thread> thread = StartThread(
        "adjustment of the map", [this, map = mapper->map()] { Compute(map); },
        [this](const absl::Status& status) { Done(status); });
    if (thread.ok()) {
      thread_ = *std::move(thread);
      return absl::OkStatus();
    }
  }
  Compute(mapper->map());
  return MergeIfDone(mapper);
}

void LoopRunner::Done(absl::StatusOr<mapping::FullAdjustment> adjustment) {
  adjustment_ = std::move(adjustment);
  done_ = true;
}

void LoopRunner::Compute(std::shared_ptr<const map::Snapshot> map) {
  mapping::FullAdjustmentOptions options;
  options.stop = &stop_;
  Done(Guarded([&] { return mapping::ComputeFullAdjustment(*map, options); }));
}

absl::Status LoopRunner::MergeIfDone(mapping::FeatureMapper* mapper) {
  if (!done_) return absl::OkStatus();
  Join();
  done_ = false;
  const absl::StatusOr<mapping::FullAdjustment> adjustment = *std::exchange(adjustment_, std::nullopt);
  // A map that could not be adjusted is as good as before.
  absl::Status merged;
  if (adjustment.ok() && !adjustment->interrupted) {
    map::Edit edit(mapper->map());
    mapping::MergeFullAdjustment(*adjustment, edit);
    merged = mapper->CommitCorrection(edit.Finish("full bundle adjustment"), {}).status();
  }
  adjustments_.back().end = std::chrono::steady_clock::now();
  return merged;
}

absl::Status LoopRunner::Finish(mapping::FeatureMapper* mapper) {
  Join();
  return MergeIfDone(mapper);
}

}  // namespace cairn::engine

#include "engine/loop_runner.h"

#include <utility>

#include "base/guarded.h"
#include "engine/session_record.h"
#include "map/edit.h"

namespace cairn::engine {
namespace {

void Remember(const LoopRunner::Span& span, std::deque<LoopRunner::Span>* spans) {
  spans->push_back(span);
  if (spans->size() > LoopRunner::kRecentSpans) spans->pop_front();
}

}  // namespace

absl::StatusOr<std::unique_ptr<LoopRunner>> LoopRunner::Create(const LoopRunnerOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(mapping::LoopCloser closer, mapping::LoopCloser::Create(options.loops));
  CAIRN_ASSIGN_OR_RETURN(mapping::ComponentJoiner joiner, mapping::ComponentJoiner::Create(options.joins));
  return std::unique_ptr<LoopRunner>(new LoopRunner(options, std::move(closer), std::move(joiner)));
}

LoopRunner::~LoopRunner() {
  stop_ = true;
  WaitForAdjustment();
}

void LoopRunner::WaitForAdjustment() {
  if (thread_.joinable()) thread_.join();
}

absl::Status LoopRunner::AfterPacket(const mapping::KeyframeReport& packet, mapping::MapHead& head) {
  CAIRN_RETURN_IF_ERROR(MergePart(head).status());
  if (!packet.inserted || head.View()->places() == nullptr) return absl::OkStatus();
  CAIRN_ASSIGN_OR_RETURN(bool corrected, Join(packet.keyframe, head));
  if (!corrected && options_.close_loops) {
    CAIRN_ASSIGN_OR_RETURN(corrected, CloseLoop(packet.keyframe, head));
  }
  return corrected ? StartAdjustment(packet.keyframe, head) : absl::OkStatus();
}

absl::StatusOr<bool> LoopRunner::Join(KeyframeId keyframe, mapping::MapHead& head) {
  const auto begin = Clock::now();
  CAIRN_ASSIGN_OR_RETURN(mapping::JoinReport report,
                         joiner_.Process(keyframe, options_.record_wall_clock ? UnixNowNs() : 0, head));
  if (report.searched) search_ms_.Add(static_cast<float>(report.search_ms + report.verify_ms));
  expects_join_ = report.seen && !report.joined;
  if (expects_join_) ++joins_rejected_[report.rejected];
  if (!report.joined && report.calibration_doubted && report.rejected != mapping::kCalibrationRefused) {
    ++joins_rejected_[mapping::kCalibrationRefused];
  }
  if (!report.joined) return false;
  Remember({begin, Clock::now()}, &corrections_);
  joins_.push_back(std::move(report));
  return true;
}

absl::StatusOr<bool> LoopRunner::CloseLoop(KeyframeId keyframe, mapping::MapHead& head) {
  const auto begin = Clock::now();
  CAIRN_ASSIGN_OR_RETURN(mapping::LoopReport report, closer_.Process(keyframe, head));
  search_ms_.Add(static_cast<float>(report.detect_ms + report.verify_ms));
  if (report.candidates > 0 && !report.closed) ++rejected_[report.evidence.rejected];
  if (!report.closed) return false;
  const std::chrono::duration<double, std::milli> searched(report.detect_ms + report.verify_ms);
  Remember({begin + std::chrono::duration_cast<Clock::duration>(searched), Clock::now()}, &corrections_);
  loops_.push_back(std::move(report));
  return true;
}

absl::Status LoopRunner::StartAdjustment(KeyframeId keyframe, mapping::MapHead& head) {
  // One that is under way is about the map before this loop or join.
  stop_ = true;
  if (thread_.joinable() || merge_) DropAdjustment();
  stop_ = stale_ = false;
  Remember({Clock::now(), Clock::time_point::max()}, &adjustments_);
  const std::shared_ptr<const map::Snapshot> map = head.View()->snapshot();
  const ComponentId component = map->keyframe(keyframe).component;
  session_ = map->keyframe(keyframe).session;
  if (options_.in_background) {
    absl::StatusOr<std::thread> thread = StartThread(
        "adjustment of the map", [this, map, component] { Compute(map, component); },
        [this](const absl::Status& status) { Done(status); });
    if (thread.ok()) {
      thread_ = *std::move(thread);
      return absl::OkStatus();
    }
  }
  Compute(map, component);
  for (;;) {
    CAIRN_ASSIGN_OR_RETURN(const bool more, MergePart(head));
    if (!more) return absl::OkStatus();
  }
}

void LoopRunner::Done(absl::StatusOr<mapping::FullAdjustment> adjustment) {
  adjustment_ = std::move(adjustment);
  done_ = true;
}

void LoopRunner::Compute(std::shared_ptr<const map::Snapshot> map, ComponentId component) {
  mapping::FullAdjustmentOptions options;
  options.session = session_;
  options.stop = &stop_;
  Done(Guarded([&] { return mapping::ComputeFullAdjustment(*map, component, options); }));
}

void LoopRunner::DropAdjustment() {
  WaitForAdjustment();
  done_ = false;
  adjustment_.reset();
  merge_.reset();
  adjustments_.back().end = Clock::now();
}

absl::StatusOr<bool> LoopRunner::MergePart(mapping::MapHead& head) {
  if (done_) {
    WaitForAdjustment();
    done_ = false;
    absl::StatusOr<mapping::FullAdjustment> adjustment = *std::exchange(adjustment_, std::nullopt);
    // A map that could not be adjusted is as good as before.
    if (adjustment.ok() && !adjustment->interrupted) merge_.emplace(*std::move(adjustment));
    parts_merged_ = 0;
    if (!merge_) adjustments_.back().end = Clock::now();
  }
  if (!merge_) return false;
  if (stale_) {
    DropAdjustment();
    return false;
  }
  map::Edit edit(head.View()->snapshot());
  merge_->MergeNext(edit, options_.points_per_part);
  edit.SetSession(session_);
  const bool more = !merge_->done();
  std::string reason = "full bundle adjustment";
  if (more || parts_merged_ > 0) absl::StrAppend(&reason, ", part ", parts_merged_ + 1);
  ++parts_merged_;
  const absl::Status merged = head.Commit(edit.Finish(std::move(reason)), {});
  if (!more || !merged.ok()) DropAdjustment();
  CAIRN_RETURN_IF_ERROR(merged);
  return more;
}

}  // namespace cairn::engine

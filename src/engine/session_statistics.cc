#include "engine/session_statistics.h"

#include <algorithm>
#include <chrono>

#include "absl/strings/str_cat.h"

namespace cairn::engine {
namespace {

SampleReservoir LengthsMs(const std::deque<LoopRunner::Span>& spans) {
  SampleReservoir ms;
  for (const LoopRunner::Span& span : spans) {
    ms.Add(std::chrono::duration<float, std::milli>(span.end - span.begin).count());
  }
  return ms;
}

SampleReservoir FramesWhileCorrecting(const LoopRunner& loops, const OdometryRunner& runner) {
  SampleReservoir during;
  for (const OdometryRunner::TimedFrame& frame : runner.recent_frames()) {
    const std::chrono::duration<double, std::milli> lasted(frame.ms);
    const auto overlaps = [&](const LoopRunner::Span& span) {
      return frame.begin < span.end && frame.begin + lasted > span.begin;
    };
    if (std::any_of(loops.corrections().begin(), loops.corrections().end(), overlaps) ||
        std::any_of(loops.adjustments().begin(), loops.adjustments().end(), overlaps)) {
      during.Add(frame.ms);
    }
  }
  return during;
}

}  // namespace

void SessionStatistics::Add(const mapping::KeyframeReport& report) {
  keyframe_ms_.Add(static_cast<float>(report.times.total_ms));
  keyframe_reports_.push_back(report);
  if (keyframe_reports_.size() > kRecentKeyframes) keyframe_reports_.pop_front();
  const bool lost = report.state == mapping::FeatureState::kLost;
  if (lost && !feature_lost_) ++feature_losses_;
  feature_lost_ = lost;
}

std::string SessionStatistics::WhyNoMap() const {
  if (keyframe_reports_.empty()) return "none of them left its window for the feature module";
  const mapping::KeyframeReport& best =
      *std::ranges::max_element(keyframe_reports_, {}, &mapping::KeyframeReport::depths);
  return absl::StrCat("the feature module could not start on any of the ", keyframe_reports_.size(),
                      " that it was given: ", best.message, " among the ", best.features, " of the best");
}

void SessionStatistics::Fill(const LoopRunner& loops, const OdometryRunner& runner, SessionReport* report) const {
  report->feature_losses = feature_losses_;
  report->loops = loops.loops();
  report->loops_rejected = loops.rejected();
  report->joins = loops.joins();
  report->joins_rejected = loops.joins_rejected();
  report->loop_search_ms = loops.search_ms();
  report->correction_ms = LengthsMs(loops.corrections());
  report->adjustment_ms = LengthsMs(loops.adjustments());
  report->frame_ms_correcting = FramesWhileCorrecting(loops, runner);
  report->frame_ms = runner.frame_ms();
  report->keyframe_ms = keyframe_ms_;
  report->keyframe_reports.assign(keyframe_reports_.begin(), keyframe_reports_.end());
}

std::vector<ComponentShare> SharesOf(const map::Snapshot& map, const std::vector<FramePose>& frames) {
  std::vector<ComponentShare> shares;
  for (const ComponentId id : map.LiveComponents()) shares.push_back({.id = id, .keyframes = map.NumKeyframes(id)});
  for (const FramePose& frame : frames) {
    const auto share = std::ranges::find(shares, frame.component, &ComponentShare::id);
    if (!frame.map_from_camera || share == shares.end()) continue;
    if (share->frames++ == 0) share->first_ns = frame.time_ns;
    share->last_ns = frame.time_ns;
  }
  return shares;
}

}  // namespace cairn::engine

#include "cli/run_feed.h"

#include <cstdio>
#include <iostream>
#include <optional>

#include "absl/strings/str_format.h"
#include "base/guarded.h"
#include "cli/process_memory.h"
#include "cli/sample_statistics.h"
#include "direct/odometry.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

using Clock = std::chrono::steady_clock;

double Share(std::int64_t part, std::int64_t of) {
  return of > 0 ? static_cast<double>(part) / static_cast<double>(of) : 0.0;
}

double RealtimeFactor(const FeedReport& report) {
  return report.elapsed_s > 0.0 ? report.covered_s / report.elapsed_s : 0.0;
}

}  // namespace

engine::SessionSource ToSessionSource(const io::SourceInfo& info) {
  engine::SessionSource source;
  source.name = info.name;
  source.camera = info.camera;
  source.photometric = info.photometric;
  source.first_ns = info.first_time_ns;
  return source;
}

engine::RawFrame ToRaw(const io::SourceFrame& frame) {
  return {frame.sequence_index, frame.time_ns, frame.gray, frame.exposure_s};
}

namespace {

void NoteGap(double before_s, double after_s, const io::SourceInfo& info, FeedReport* report) {
  const double gap_s = after_s - before_s;
  const double frame_s = info.num_frames > 1 ? info.duration_s / static_cast<double>(info.num_frames - 1) : 0.0;
  if (!direct::IsLongGap(gap_s, frame_s)) return;
  ++report->gaps;
  if (gap_s <= report->longest_gap_s) return;
  report->longest_gap_s = gap_s;
  report->longest_gap_at_s = before_s;
}

}  // namespace

absl::StatusOr<FeedReport> FeedSequence(
    const FeedSettings& settings, io::FrameSource* source, const engine::FramePreparation& preparation,
    InterruptWatch* interrupt, const std::function<absl::StatusOr<std::string>(const engine::FedFrame&)>& handle,
    const std::function<absl::Status()>& finish) {
  FeedReport report;
  report.realtime = settings.feed.realtime_speed > 0.0;
  SkippedFrames skipped(settings.verb, settings.quiet);
  Progress progress(settings.progress, source->info().num_frames, settings.quiet);
  const Clock::time_point start = Clock::now();
  {
    engine::FrameFeed feed(settings.feed, preparation, [&]() -> absl::StatusOr<std::optional<engine::RawFrame>> {
      for (;;) {
        CAIRN_ASSIGN_OR_RETURN(const std::optional<io::SourceFrame> frame, source->Next());
        if (!frame) return std::optional<engine::RawFrame>();
        if (frame->status.ok()) return std::optional<engine::RawFrame>(ToRaw(*frame));
        skipped.Add(frame->path, frame->status);
      }
    });
    std::optional<InterruptWatch::Guard> guard;
    if (interrupt != nullptr) guard.emplace(interrupt, [&] { feed.Stop(); });
    for (std::int64_t taken = 1;; ++taken) {
      CAIRN_ASSIGN_OR_RETURN(const std::optional<engine::FedFrame> fed, feed.Next());
      if (!fed) break;
      CAIRN_ASSIGN_OR_RETURN(const std::string note, Guarded([&] { return handle(*fed); }));
      const double at_s = ToSeconds(fed->frame.time_ns - source->info().first_time_ns);
      if (taken > 1) NoteGap(report.covered_s, at_s, source->info(), &report);
      report.covered_s = at_s;
      report.prepare_ms.Add(fed->prepare_ms);
      if (report.realtime) {
        report.latency_ms.Add(std::chrono::duration<float, std::milli>(Clock::now() - fed->arrival).count());
      }
      progress.Update(taken + feed.dropped(), note);
    }
    report.dropped = feed.dropped();
    report.refused = feed.refused();
    if (report.refused > 0 && !settings.quiet) {
      std::cerr << "cairn " << settings.verb << ": " << report.refused
                << " frames were left out for their times; the first: " << feed.first_refusal().message() << "\n";
    }
  }
  CAIRN_RETURN_IF_ERROR(Guarded(finish));
  progress.Finish();
  report.skipped = skipped.count();
  report.elapsed_s = std::chrono::duration<double>(Clock::now() - start).count();
  return report;
}

void AddFeedJson(const FeedReport& report, const io::SourceInfo& info, std::int64_t frames_tracked,
                 const InterruptWatch& interrupt, nlohmann::ordered_json* json) {
  json->update({{"frames", info.num_frames},
                {"frames_tracked", frames_tracked},
                {"tracked_share", Share(frames_tracked, info.num_frames)},
                {"frames_skipped", report.skipped},
                {"frames_dropped", report.dropped},
                {"frames_out_of_order", report.refused},
                {"gaps", report.gaps},
                {"longest_gap_s", report.longest_gap_s},
                {"longest_gap_at_s", report.longest_gap_at_s},
                {"interrupted", interrupt.exit_code() != 0},
                {"elapsed_s", report.elapsed_s},
                {"duration_s", info.duration_s},
                {"realtime_factor", RealtimeFactor(report)},
                {"peak_memory_mb", PeakMemoryMb()}});
  if (!info.notes.empty()) (*json)["input_notes"] = info.notes;
  if (report.realtime) (*json)["latency_ms"] = SampleStatistics(report.latency_ms);
}

void PrintFeed(const FeedReport& report, const io::SourceInfo& info, std::int64_t frames_tracked,
               const InterruptWatch& interrupt) {
  text::Say(absl::StrFormat(
      "  tracked %lld of %lld frames (%.1f %%) in %.1f s, %.1f x real time; at most %.0f MB of memory\n",
      static_cast<long long>(frames_tracked), static_cast<long long>(info.num_frames),
      100.0 * Share(frames_tracked, info.num_frames), report.elapsed_s, RealtimeFactor(report), PeakMemoryMb()));
  if (report.realtime) {
    text::Say(absl::StrFormat(
        "  played as a live camera: %lld frames dropped; from frame to pose %.2f ms median, %.2f ms p99\n",
        static_cast<long long>(report.dropped), report.latency_ms.Percentile(0.5), report.latency_ms.Percentile(0.99)));
  }
  if (report.skipped > 0)
    text::Say(absl::StrFormat("  %lld images could not be used\n", static_cast<long long>(report.skipped)));
  if (report.gaps > 0) {
    text::Say(absl::StrFormat(
        "  %d gaps without images, the longest %.1f s at %.1f s: what comes after one may be misplaced\n", report.gaps,
        report.longest_gap_s, report.longest_gap_at_s));
  }
  if (interrupt.exit_code() != 0) text::Say("  interrupted: this is what was done until then\n");
}

}  // namespace cairn::cli

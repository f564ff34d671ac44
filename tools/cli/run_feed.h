// From the images of a sequence to a session: reads and prepares ahead, skips what is damaged, shows the progress, ends
// early when interrupted; with --realtime at the pace of the recording.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>

#include "base/sample_reservoir.h"
#include "cli/cli.h"
#include "cli/input_options.h"
#include "cli/interrupt.h"
#include "direct/packet.h"
#include "engine/frame_feed.h"
#include "engine/session_record.h"
#include "io/frame_source.h"

namespace cairn::cli {

// The stream that a session is told of.
engine::SessionSource ToSessionSource(const io::SourceInfo& info);
engine::RawFrame ToRaw(const io::SourceFrame& frame);

struct FeedReport {
  std::int64_t skipped = 0;    // images that could not be used
  std::int64_t dropped = 0;    // frames that came too fast, in real time
  std::int64_t refused = 0;    // frames whose time does not follow that of the one before
  SampleReservoir prepare_ms;  // undistortion and photometric correction
  SampleReservoir latency_ms;  // from the arrival of a frame to its pose; in real time
  double elapsed_s = 0.0;
  double covered_s = 0.0;  // of the recording
  // Stretches without images: of more than half a second and five times the time between two.
  int gaps = 0;
  double longest_gap_s = 0.0;
  double longest_gap_at_s = 0.0;  // since the first image
  bool realtime = false;
};

struct FeedSettings {
  engine::FrameFeedOptions feed;
  std::string verb;      // for messages
  std::string progress;  // what the bar is called
  bool quiet = false;
};

// Gives every frame to `handle`, which returns the note behind the bar; its errors end the feed. `interrupt` may be
// null. The clock starts with the first frame and runs until `finish` returns.
absl::StatusOr<FeedReport> FeedSequence(
    const FeedSettings& settings, io::FrameSource* source, const engine::FramePreparation& preparation,
    InterruptWatch* interrupt, const std::function<absl::StatusOr<std::string>(const engine::FedFrame&)>& handle,
    const std::function<absl::Status()>& finish);

// What every run tells of its feed: frames given, tracked, skipped and dropped, times, peak memory.
void AddFeedJson(const FeedReport& report, const io::SourceInfo& info, std::int64_t frames_tracked,
                 const InterruptWatch& interrupt, nlohmann::ordered_json* json);
void PrintFeed(const FeedReport& report, const io::SourceInfo& info, std::int64_t frames_tracked,
               const InterruptWatch& interrupt);

}  // namespace cairn::cli

// cairn bench: how fast, and with how much memory.
#include <cstdio>

#include "cli/bench_adjustment.h"
#include "cli/bench_follow.h"
#include "cli/bench_server.h"
#include "cli/cli.h"
#include "cli/input_options.h"
#include "cli/process_memory.h"
#include "cli/run_feed.h"
#include "cli/sample_statistics.h"
#include "direct/odometry_options.h"
#include "engine/odometry_session.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct BenchOptions {
  InputOptions input;
  std::string preset = "default";
  engine::OdometrySessionOptions session;
  bool full_resolution = false;
  double realtime_speed = 0.0;
  bool json = false;
};

// A sequence in memory. Each image is given as a copy, as a camera's driver would make it: what the odometry keeps is
// then memory of its own.
class PreloadedSource : public io::FrameSource {
 public:
  static absl::StatusOr<std::unique_ptr<PreloadedSource>> Load(io::FrameSource* source, SkippedFrames* skipped) {
    auto loaded = std::make_unique<PreloadedSource>();
    for (;;) {
      CAIRN_ASSIGN_OR_RETURN(std::optional<io::SourceFrame> frame, source->Next());
      if (!frame) break;
      if (!frame->status.ok()) {
        skipped->Add(frame->path, frame->status);
        continue;
      }
      loaded->bytes_ += frame->gray.total() * frame->gray.elemSize();
      loaded->frames_.push_back(*std::move(frame));
    }
    loaded->info_ = source->info();
    loaded->info_.num_frames = static_cast<std::int64_t>(loaded->frames_.size());
    return loaded;
  }

  const io::SourceInfo& info() const override { return info_; }
  absl::StatusOr<std::optional<io::SourceFrame>> Next() override {
    if (next_ == frames_.size()) return std::optional<io::SourceFrame>();
    io::SourceFrame frame = frames_[next_++];
    frame.gray = frame.gray.clone();
    return std::optional<io::SourceFrame>(std::move(frame));
  }
  double megabytes() const { return 1e-6 * static_cast<double>(bytes_); }

 private:
  io::SourceInfo info_;
  std::vector<io::SourceFrame> frames_;
  std::size_t bytes_ = 0;
  std::size_t next_ = 0;
};

struct Stage {
  const char* name;
  const char* what;
  const SampleReservoir& samples_ms;
};

struct Bench {
  FeedReport feed;
  engine::OdometryReport odometry;
  double peak_memory_mb = 0.0;  // without the images held ready

  std::vector<Stage> Stages() const {
    const direct::OdometryStatistics& s = odometry.odometry;
    return {{"prepare", "per frame: undistortion, photometric correction", feed.prepare_ms},
            {"pyramid", "per frame, part of track", s.pyramid.samples_ms},
            {"track", "per frame", s.track.samples_ms},
            {"start", "per frame until the first keyframes", s.start.samples_ms},
            {"trace", "per frame, mapping", s.trace.samples_ms},
            {"activate", "per keyframe", s.activate.samples_ms},
            {"optimize", "per keyframe", s.optimize.samples_ms},
            {"marginalize", "per keyframe", s.marginalize.samples_ms},
            {"frame", "per frame: from AddFrame() to the pose", odometry.frame_ms}};
  }
};

void PrintBench(const BenchOptions& options, const Bench& bench, const PreloadedSource& source) {
  const engine::OdometryReport& report = bench.odometry;
  const double speed = bench.feed.elapsed_s > 0.0 ? source.info().duration_s / bench.feed.elapsed_s : 0.0;
  if (options.json) {
    nlohmann::ordered_json stages;
    for (const Stage& stage : bench.Stages()) {
      stages[stage.name] = {{"calls", stage.samples_ms.count()}};
      stages[stage.name].update(SampleStatistics(stage.samples_ms));
    }
    nlohmann::ordered_json json = {{"sequence", source.info().name},
                                   {"preset", options.preset},
                                   {"threads", options.session.deterministic ? 1 : options.session.threads},
                                   {"realtime_speed", options.realtime_speed},
                                   {"frames", source.info().num_frames},
                                   {"frames_tracked", report.frames_tracked},
                                   {"frames_dropped", bench.feed.dropped},
                                   {"segments", report.segments},
                                   {"direct_keyframes", report.keyframe_poses.size()},
                                   {"elapsed_s", bench.feed.elapsed_s},
                                   {"duration_s", source.info().duration_s},
                                   {"realtime_factor", speed},
                                   {"peak_memory_mb", bench.peak_memory_mb},
                                   {"preloaded_mb", source.megabytes()},
                                   {"stages_ms", stages}};
    if (bench.feed.realtime) json["latency_ms"] = SampleStatistics(bench.feed.latency_ms);
    PrintJson(json);
    return;
  }
  std::printf("%s, preset %s, %s: %lld of %lld frames tracked, %lld dropped, %zu keyframes\n",
              text::Shown(source.info().name).c_str(), options.preset.c_str(),
              options.session.deterministic || options.session.threads == 1 ? "one thread" : "two threads",
              static_cast<long long>(report.frames_tracked), static_cast<long long>(source.info().num_frames),
              static_cast<long long>(bench.feed.dropped), report.keyframe_poses.size());
  std::printf("  %.1f s for %.1f s of images: %.1f x real time%s\n", bench.feed.elapsed_s, source.info().duration_s,
              speed, bench.feed.realtime ? " (played at its pace)" : "");
  std::printf("  at most %.0f MB of memory, besides %.0f MB of images held ready\n\n", bench.peak_memory_mb,
              source.megabytes());
  std::printf("  %-12s %7s %9s %9s %9s %9s\n", "ms", "calls", "median", "mean", "p99", "total s");
  for (const Stage& stage : bench.Stages()) {
    if (stage.samples_ms.empty()) continue;
    std::printf("  %-12s %7lld %9.3f %9.3f %9.3f %9.2f  %s\n", stage.name,
                static_cast<long long>(stage.samples_ms.count()), stage.samples_ms.Percentile(0.5),
                stage.samples_ms.mean(), stage.samples_ms.Percentile(0.99), 1e-3 * stage.samples_ms.sum(), stage.what);
  }
}

absl::Status BenchDirect(const BenchOptions& options) {
  engine::OdometrySessionOptions session_options = options.session;
  CAIRN_ASSIGN_OR_RETURN(const direct::Preset preset, direct::PresetFromName(options.preset));
  session_options.odometry = direct::PresetOptions(preset);
  session_options.odometry.full_resolution |= options.full_resolution;
  SkippedFrames skipped("bench", options.json);
  std::unique_ptr<PreloadedSource> source;
  {
    CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<io::FrameSource> files, OpenInput(options.input, "bench direct"));
    CAIRN_ASSIGN_OR_RETURN(source, PreloadedSource::Load(files.get(), &skipped));
  }
  ResetPeakMemory();
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<engine::OdometrySession> session,
                         engine::OdometrySession::Create(session_options, ToSessionSource(source->info())));
  Bench bench;
  FeedSettings settings;
  settings.verb = "bench";
  settings.progress = "tracking";
  settings.quiet = options.json;
  settings.feed.in_background = !session_options.deterministic && session_options.threads > 1;
  settings.feed.realtime_speed = options.realtime_speed;
  const auto add = [&](const engine::FedFrame& fed) -> absl::StatusOr<std::string> {
    const direct::Frame& frame = fed.frame;
    CAIRN_ASSIGN_OR_RETURN(const direct::FrameResult result, session->AddFrame(frame));
    return result.message;
  };
  const auto finish = [&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(bench.odometry, session->Finish());
    return absl::OkStatus();
  };
  CAIRN_ASSIGN_OR_RETURN(bench.feed,
                         FeedSequence(settings, source.get(), session->preparation(), nullptr, add, finish));
  bench.peak_memory_mb = PeakMemoryMb() - source->megabytes();
  PrintBench(options, bench, *source);
  return absl::OkStatus();
}

}  // namespace

void AddBenchCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("bench", "Measure speed and memory");
  verb->require_subcommand(1);
  AddBenchServerCommand(app, verb, action);
  AddBenchFollowCommand(app, verb, action);
  AddBenchAdjustmentCommand(verb, action);
  CLI::App* odometry = verb->add_subcommand(
      "direct", "The direct odometry: time per stage, speed against real time, frames dropped, peak memory");
  auto options = std::make_shared<BenchOptions>();
  AddInputOptions(odometry, &options->input);
  odometry->add_option("--preset", options->preset, "As of cairn run")
      ->check(CLI::IsMember({"fast", "default", "accurate"}))
      ->capture_default_str();
  odometry->add_flag("--full-resolution", options->full_resolution, "Track on full instead of half resolution");
  odometry->add_option("--threads", options->session.threads, "1: everything in one; 2: mapping in one of its own")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  odometry
      ->add_option("--realtime", options->realtime_speed,
                   "Play the sequence like a live camera, at SPEED times its own pace (1 if not given)")
      ->type_name("[SPEED]")
      ->check(CLI::Range(0.001, 1000.0));
  odometry->add_flag("--json", options->json, "Answer in JSON");
  odometry->footer(
      "All images are decoded before the clock starts; their memory is not counted.\n"
      "Examples:\n"
      "  cairn bench direct rgbd_dataset --camera camera.yaml\n"
      "  cairn bench direct rgbd_dataset --camera camera.yaml --realtime --json");
  odometry->callback([=] {
    *action = [=] {
      const absl::Status status = BenchDirect(*options);
      return status.ok() ? kOk : Fail("bench", status, options->json);
    };
  });
}

}  // namespace cairn::cli

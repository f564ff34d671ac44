// cairn synth: renders a virtual recording with ground truth.
#include <chrono>
#include <cstdio>

#include "cli/cli.h"
#include "synth/write.h"

namespace cairn::cli {
namespace {

struct SynthOptions {
  std::string preset;
  std::string out;
  std::string format = "euroc";
  std::vector<std::string> effects;
  std::uint64_t seed = 1;
  int session = 1;
  std::vector<double> size_m;  // along x and y
  double laps = 0.0;
  double rate_hz = 0.0;
  double duration_s = 0.0;
  int threads = 2;
  bool overwrite = false;
  bool json = false;
};

std::string Join(const std::vector<std::string>& names) {
  std::string joined;
  for (const std::string& name : names) joined += (joined.empty() ? "" : ", ") + name;
  return joined;
}

absl::Status Synthesize(const SynthOptions& options) {
  synth::DatasetOptions dataset;
  CAIRN_ASSIGN_OR_RETURN(dataset.sequence, synth::Preset(options.preset));
  CAIRN_ASSIGN_OR_RETURN(dataset.format, synth::DatasetFormatFromName(options.format));
  for (const std::string& effect : options.effects) {
    CAIRN_RETURN_IF_ERROR(synth::SetEffect(effect, true, dataset.sequence));
  }
  dataset.sequence.world.seed = options.seed;
  dataset.sequence.trajectory.seed = options.seed;
  dataset.sequence.trajectory.session = options.session - 1;
  if (!options.size_m.empty()) dataset.sequence.world.size_m.head<2>() = Vector2d(options.size_m.data());
  if (options.laps > 0.0) dataset.sequence.trajectory.laps = options.laps;
  if (options.rate_hz > 0.0) dataset.sequence.rate_hz = options.rate_hz;
  dataset.sequence.max_duration_s = options.duration_s;
  dataset.threads = options.threads;
  dataset.overwrite = options.overwrite;

  const auto start = std::chrono::steady_clock::now();
  int frames = 0;
  std::unique_ptr<Progress> progress;
  CAIRN_RETURN_IF_ERROR(synth::GenerateDataset(dataset, options.out, [&](int done, int total) {
    if (!progress) progress = std::make_unique<Progress>("rendering", total, options.json);
    progress->Update(done, absl::StrCat(done, " of ", total, " images"));
    frames = total;
    return true;
  }));
  if (progress) progress->Finish();
  const double elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (options.json) {
    PrintJson({{"dataset", options.out}, {"format", options.format}, {"frames", frames}, {"elapsed_s", elapsed_s}});
  } else {
    std::printf("%s: %d images with ground truth, %.1f images/s\n", options.out.c_str(), frames, frames / elapsed_s);
  }
  return absl::OkStatus();
}

}  // namespace

void AddSynthCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("synth", "Render a virtual recording with ground truth");
  auto options = std::make_shared<SynthOptions>();
  verb->add_option("PRESET", options->preset, "The world: " + Join(synth::PresetNames()))
      ->required()
      ->check(CLI::IsMember(synth::PresetNames()));
  verb->add_option("--out", options->out, "Folder to write")->required();
  verb->add_option("--format", options->format, "Layout of the folder")
      ->check(CLI::IsMember({"euroc", "tum_mono"}))
      ->capture_default_str();
  verb->add_option("--seed", options->seed, "Of the world, the path and the noise")->capture_default_str();
  verb->add_option("--session", options->session, "Other paths through the same world: 1, 2, ...")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  verb->add_option("--size", options->size_m, "Of the room, or of the corridor's outer wall, in metres: X Y")
      ->expected(2);
  verb->add_option("--laps", options->laps, "Rounds; the preset's if not given")->check(CLI::Range(0.05, 100.0));
  verb->add_option("--rate", options->rate_hz, "Images per second; the preset's if not given")
      ->check(CLI::Range(0.1, 1000.0));
  verb->add_option("--duration", options->duration_s, "Stop after so many seconds")->check(CLI::Range(0.01, 1e6));
  verb->add_option("--effects", options->effects, "What spoils the images: " + Join(synth::EffectNames()))
      ->delimiter(',');
  verb->add_option("--threads", options->threads, "Images rendered at a time")->capture_default_str();
  verb->add_flag("--overwrite", options->overwrite, "Replace a recording in the folder");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "Examples:\n"
      "  cairn synth office --out office\n"
      "  cairn synth corridor --seed 3 --effects noise,blur --format tum_mono --out corridor");
  verb->callback([=] {
    *action = [=] {
      const absl::Status status = Synthesize(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("synth", status, options->json);
    };
  });
}

}  // namespace cairn::cli

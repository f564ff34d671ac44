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
  std::vector<int> image_size_px;
  double focal_px = 0.0;
  double gamma = 0.0;
  double light = 0.0;
  std::uint64_t catalogue = 0;
  int overlap_with = 0;
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
  const bool sized = !options.image_size_px.empty();
  synth::SetCamera(sized ? options.image_size_px[0] : 0, sized ? options.image_size_px[1] : 0, options.focal_px,
                   dataset.sequence);
  if (options.gamma > 0.0) dataset.sequence.effects.gamma = options.gamma;
  if (options.light > 0.0) dataset.sequence.effects.white_level *= options.light;
  if (options.catalogue > 0) dataset.sequence.world.catalogue = options.catalogue;
  if (options.overlap_with > 0) dataset.overlap_with_session = options.overlap_with - 1;
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
  verb->add_option("--image-size", options->image_size_px, "In pixels: X Y; 640 480 if not given")
      ->expected(2)
      ->check(CLI::Range(16, 8192));
  verb->add_option("--focal", options->focal_px, "Focal length in pixels; 420 if not given")
      ->check(CLI::Range(10.0, 1e5));
  verb->add_option("--gamma", options->gamma, "Of the camera's response; 1, linear, if not given")
      ->check(CLI::Range(0.2, 5.0));
  verb->add_option("--light", options->light, "Times the usual exposure")->check(CLI::Range(0.05, 3.0));
  verb->add_option("--catalogue", options->catalogue,
                   "Furnish rooms from this catalogue of few models, as other worlds with the same number are");
  verb->add_option("--overlap-with", options->overlap_with,
                   "Write overlap.txt: how much of each view this session of the same world shows too")
      ->check(CLI::Range(1, 1000));
  verb->add_option("--effects", options->effects, "What spoils the images: " + Join(synth::EffectNames()))
      ->delimiter(',');
  verb->add_option("--threads", options->threads, "Images rendered at a time")->capture_default_str();
  verb->add_flag("--overwrite", options->overwrite, "Replace a recording in the folder");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "Examples:\n"
      "  cairn synth office --out office\n"
      "  cairn synth corridor --seed 3 --effects noise,blur --format tum_mono --out corridor\n"
      "Sessions of one world share its frame and that of the ground truth:\n"
      "  cairn synth rooms --seed 3 --rate 15 --out visit_1\n"
      "  cairn synth rooms --seed 3 --rate 15 --session 2 --overlap-with 1 --out visit_2\n"
      "  cairn synth office --session 3 --image-size 1280 800 --focal 1000 --gamma 1.8 --light 0.7 --out visit_3\n"
      "A processor renders about 7 images of 640x480 per second, and 2 of 1280x800.");
  verb->callback([=] {
    *action = [=] {
      const absl::Status status = Synthesize(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("synth", status, options->json);
    };
  });
}

}  // namespace cairn::cli

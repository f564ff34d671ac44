// cairn synth: renders a virtual recording with ground truth.
#include <chrono>
#include <cstdio>

#include "cli/cli.h"
#include "synth/map_copies.h"
#include "synth/write.h"
#include "text/text.h"

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
  if (options.duration_s > 0.0) dataset.sequence.max_duration_s = options.duration_s;
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
    std::printf("%s: %d images with ground truth, %.1f images/s\n", text::Shown(options.out).c_str(), frames,
                frames / elapsed_s);
  }
  return absl::OkStatus();
}

absl::Status CopyMap(const synth::MapCopiesOptions& options, const std::string& out, bool json) {
  Progress progress("copying", options.keyframes, json);
  CAIRN_ASSIGN_OR_RETURN(const synth::MapCopies copies, synth::CopyMap(options, out, [&](std::int64_t done) {
                           progress.Update(done, absl::StrCat(done, " of ", options.keyframes, " keyframes"));
                         }));
  progress.Finish();
  if (json) {
    PrintJson(
        {{"map", out}, {"keyframes", copies.keyframes}, {"points", copies.points}, {"components", copies.components}});
  } else {
    std::printf("%s: %lld keyframes, %lld points, %d components\n", text::Shown(out).c_str(),
                static_cast<long long>(copies.keyframes), static_cast<long long>(copies.points), copies.components);
  }
  return absl::OkStatus();
}

void AddSynthMapCommand(CLI::App* synth, Action* action) {
  CLI::App* verb = synth->add_subcommand("map", "Make a large map out of copies of a real one");
  struct Options {
    synth::MapCopiesOptions copies;
    std::string out;
    bool json = false;
  };
  auto options = std::make_shared<Options>();
  verb->add_option("--like", options->copies.like, "The map whose components are copied")->required();
  verb->add_option("--out", options->out, "Map file to write")->required();
  verb->add_option("--keyframes", options->copies.keyframes, "At least so many")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  verb->add_flag("--alike{false}", options->copies.other_places,
                 "The copies look alike but for the flipped bits; if not given, like other places");
  verb->add_option("--flipped-bits", options->copies.flipped_bits,
                   "Share of each descriptor's bits that differ in all copies but the first")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  verb->add_option("--seed", options->copies.seed, "Of what differs")->capture_default_str();
  verb->add_flag("--overwrite", options->copies.overwrite, "Replace a map that exists");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "For tests and benchmarks of large maps. Each copy is a component of its own.\n"
      "Example:\n"
      "  cairn synth map --like office.cairn --keyframes 10000 --out large.cairn");
  verb->callback([=] {
    *action = [=] {
      const absl::Status status = CopyMap(options->copies, options->out, options->json);
      return status.ok() ? static_cast<int>(kOk) : Fail("synth map", status, options->json);
    };
  });
}

}  // namespace

void AddSynthCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("synth", "Render a virtual recording with ground truth");
  AddSynthMapCommand(verb, action);
  auto options = std::make_shared<SynthOptions>();
  verb->add_option("PRESET", options->preset, "The world: " + Join(synth::PresetNames()))
      ->check(CLI::IsMember(synth::PresetNames()));
  verb->add_option("--out", options->out, "Folder to write");
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
    if (!verb->get_subcommands().empty()) return;
    if (options->preset.empty()) throw CLI::RequiredError("PRESET");
    if (options->out.empty()) throw CLI::RequiredError("--out");
    *action = [=] {
      const absl::Status status = Synthesize(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("synth", status, options->json);
    };
  });
}

}  // namespace cairn::cli

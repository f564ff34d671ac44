#include "cli/input_options.h"

#include <cmath>
#include <iostream>
#include <string>

#include "absl/strings/str_split.h"
#include "cli/outputs.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

const CLI::Validator kSeconds(
    [](const std::string& text) {
      double seconds = 0.0;
      const bool fits = CLI::detail::lexical_cast(text, seconds) && std::isfinite(seconds) && seconds >= 0.0;
      return fits ? std::string() : "a number of seconds, 0 or more, is needed, not " + text;
    },
    "SECONDS");

}  // namespace

void AddInputOptions(CLI::App* verb, InputOptions* options) {
  verb->add_option("DATASET", options->sequence,
                   "Folder of the sequence: EuRoC, TUM RGB-D, TUM monoVO, KITTI, images with times.txt")
      ->required();
  verb->add_option("--camera", options->open.camera_path,
                   "Calibration (camera.yaml) to use instead of the sequence's own");
  verb->add_option(
      "--photometric", options->open.photometric_path,
      "Folder with pcalib.txt, vignette.png and times.txt (exposures) to use instead of the sequence's own");
  verb->add_option("--mask", options->open.mask_path,
                   "Image of the size of the others, black where the view is to be left out, as a car's bonnet; none: "
                   "use all of it. If not given, what does not move with the scene is looked for");
  verb->add_option(
          "--camera-index", options->open.camera_index,
          "Which of several cameras (EuRoC cam0, cam1; KITTI image_0, ...); the first that there is if not given")
      ->check(CLI::Range(0, 15));
  verb->add_option("--format", options->format, "Format of the sequence, if it is not recognized")
      ->check(CLI::IsMember({"auto", "euroc", "tum_rgbd", "tum_mono", "kitti", "times", "images"}))
      ->capture_default_str();
  verb->add_option("--from", options->open.from_s, "Start, seconds after the first image")
      ->check(kSeconds)
      ->capture_default_str();
  verb->add_option("--until", options->open.until_s, "End, seconds after the first image (not included)")
      ->check(kSeconds);
  verb->add_option("--stride", options->open.stride, "Take every n-th image")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
}

std::vector<std::string> InputFiles(const InputOptions& options) {
  return {options.sequence, options.open.camera_path, options.open.photometric_path, options.open.mask_path};
}

void TellNotes(const std::string& verb, const std::vector<std::string>& notes) {
  for (const std::string& note : notes) {
    std::string head = absl::StrCat("cairn ", verb, ": ");
    for (const absl::string_view line : absl::StrSplit(note, '\n')) {
      std::cerr << text::WrappedOn(stderr, absl::StrCat(head, text::Shown(line)));
      head.clear();
    }
  }
}

absl::StatusOr<std::unique_ptr<io::FrameSource>> OpenInput(const InputOptions& options, const std::string& verb) {
  io::OpenOptions open = options.open;
  if (open.until_s <= open.from_s) {
    return UsageError(absl::StrCat("--until ", open.until_s, " is not later than --from ", open.from_s));
  }
  CAIRN_ASSIGN_OR_RETURN(open.format, io::SequenceFormatFromName(options.format));
  absl::StatusOr<std::unique_ptr<io::FrameSource>> source = io::FrameSource::Open(options.sequence, open);
  if (source.ok()) TellNotes(verb, (*source)->info().notes);
  return source;
}

void SkippedFrames::Add(const std::string& path, const absl::Status& status) {
  constexpr std::int64_t kMostTold = 5;
  ++count_;
  if (quiet_ || count_ > kMostTold) return;
  TellNotes(verb_, {absl::StrCat("skipped ", path, ": ", status.message())});
  if (count_ == kMostTold) std::cerr << "cairn " << verb_ << ": further skipped images are only counted\n";
}

}  // namespace cairn::cli

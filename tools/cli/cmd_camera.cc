// cairn camera calibrate-photometric: response, vignette and exposures of a camera from an ordinary sequence.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <iostream>

#include "absl/strings/str_format.h"
#include "cli/cli.h"
#include "cli/input_options.h"
#include "cli/interrupt.h"
#include "image/photometric_tracks.h"
#include "io/photometric_files.h"
#include "optimization/photometric_adjustment.h"
#include "plot/figures.h"

namespace cairn::cli {
namespace {

namespace fs = std::filesystem;

constexpr char kCalibrateVerb[] = "camera calibrate-photometric";
constexpr int kIntensityBins = 32, kRadiusBins = 20;
constexpr int kEnoughInBin = 20;
// Beyond these standard deviations, as shares of full scale, the sequence does not determine the calibration.
constexpr double kMaxResponseSigma = 0.02;
constexpr double kMaxVignetteSigma = 0.03;

struct CalibrateOptions {
  InputOptions input;
  std::string out;
  std::string picture;
  int max_frames = 500;
  bool ignore_exposures = false;
  bool overwrite = false;
  bool json = false;
};

struct Recording {
  io::SourceInfo info;
  std::vector<image::PhotometricSample> samples;
  std::vector<TimeNs> all_times_ns;  // of every readable image
  std::vector<TimeNs> times_ns;      // of the sampled ones
  std::vector<double> exposure_s;    // likewise; all 0 if one is unknown
  std::int64_t skipped = 0;
  double path_share = 0.0;
};

struct Coverage {
  double intensity = 0.0;  // share of the intensities, of the radii of the image, that were seen often enough
  double radius = 0.0;
  double exposure_ratio = 1.0;  // longest over shortest, known or estimated
};

struct Calibration {
  optimization::PhotometricAdjustmentResult result;
  Coverage coverage;
  bool exposures_known = false;
  io::Exposures exposures;  // of every image, if estimated
};

absl::StatusOr<Recording> Record(const CalibrateOptions& options, InterruptWatch* interrupt) {
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<io::FrameSource> source,
                         OpenInput(options.input, "camera calibrate-photometric"));
  Recording recording;
  recording.info = source->info();
  const std::int64_t frames = recording.info.num_frames;
  const std::int64_t stride = std::max<std::int64_t>(1, (frames + options.max_frames - 1) / options.max_frames);
  image::PhotometricTracker tracker;
  SkippedFrames skipped(kCalibrateVerb, options.json);
  Progress progress("following points", frames, options.json);
  bool all_known = !options.ignore_exposures;
  std::int64_t read = 0;
  std::atomic<bool> stop = false;
  const InterruptWatch::Guard guard(interrupt, [&] { stop = true; });
  while (!stop) {
    CAIRN_ASSIGN_OR_RETURN(std::optional<io::SourceFrame> frame, source->Next());
    if (!frame) break;
    if (!frame->status.ok()) {
      skipped.Add(frame->path, frame->status);
      continue;
    }
    const bool sample = read++ % stride == 0;
    CAIRN_RETURN_IF_ERROR(tracker.Add(frame->gray, sample));
    recording.all_times_ns.push_back(frame->time_ns);
    if (sample) {
      recording.times_ns.push_back(frame->time_ns);
      recording.exposure_s.push_back(frame->exposure_s);
      all_known = all_known && frame->exposure_s > 0.0;
    }
    progress.Update(frame->index + 1, absl::StrCat(tracker.points(), " points"));
  }
  progress.Finish();
  if (!all_known) std::fill(recording.exposure_s.begin(), recording.exposure_s.end(), 0.0);
  recording.samples = tracker.samples();
  recording.path_share = tracker.MedianPath();
  recording.skipped = skipped.count();
  return recording;
}

double BinsSeen(const std::vector<int>& bins) {
  const auto seen = std::count_if(bins.begin(), bins.end(), [](int count) { return count >= kEnoughInBin; });
  return static_cast<double>(seen) / static_cast<double>(bins.size());
}

Coverage Cover(const Recording& recording, const std::vector<double>& log_exposure) {
  std::vector<int> intensity(kIntensityBins, 0), radius(kRadiusBins, 0);
  for (const image::PhotometricSample& s : recording.samples) {
    ++intensity[static_cast<std::size_t>(std::clamp(s.intensity / 256.0, 0.0, 0.999) * kIntensityBins)];
    ++radius[static_cast<std::size_t>(std::clamp(s.radius, 0.0, 0.999) * kRadiusBins)];
  }
  double low = 1e9, high = -1e9;
  for (const double e : log_exposure) {
    if (std::isfinite(e)) low = std::min(low, e), high = std::max(high, e);
  }
  return {BinsSeen(intensity), BinsSeen(radius), high >= low ? std::exp(high - low) : 1.0};
}

// Log exposures between those of the sampled images by straight lines, in units of their mean.
io::Exposures ExposuresOfAll(const Recording& recording, const std::vector<double>& log_exposure) {
  std::vector<std::pair<TimeNs, double>> known;
  for (std::size_t j = 0; j < log_exposure.size(); ++j) {
    if (std::isfinite(log_exposure[j])) known.emplace_back(recording.times_ns[j], log_exposure[j]);
  }
  io::Exposures exposures;
  if (known.empty()) return exposures;
  std::size_t next = 0;
  for (const TimeNs time_ns : recording.all_times_ns) {
    while (next < known.size() && known[next].first < time_ns) ++next;
    const auto& after = known[std::min(next, known.size() - 1)];
    const auto& before = known[next > 0 ? next - 1 : 0];
    double share = 0.0;
    if (after.first > before.first) share = ToSeconds(time_ns - before.first) / ToSeconds(after.first - before.first);
    const double value = before.second + std::clamp(share, 0.0, 1.0) * (after.second - before.second);
    exposures.emplace_back(time_ns, 1e-3 * std::exp(value));
  }
  return exposures;
}

absl::Status CheckDetermined(const Recording& recording, const Calibration& calibration) {
  const auto& result = calibration.result;
  const bool response_bad = result.response_sigma > kMaxResponseSigma;
  if (!response_bad && result.vignette_sigma <= kMaxVignetteSigma) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrFormat(
      "the sequence does not determine the %s: the response is known to %.1f %% of full scale (%.0f %% needed), the "
      "vignette in the corners to %.1f %% (%.0f %%). Seen were %.0f %% of the intensities, %.0f %% of the radii, an "
      "exposure range of 1:%.2f, and points moved by %.0f %% of the image. Use a longer sequence in which things move "
      "all across the image while the exposure changes",
      response_bad ? "response" : "vignette", 100.0 * result.response_sigma, 100.0 * kMaxResponseSigma,
      100.0 * result.vignette_sigma, 100.0 * kMaxVignetteSigma, 100.0 * calibration.coverage.intensity,
      100.0 * calibration.coverage.radius, calibration.coverage.exposure_ratio, 100.0 * recording.path_share));
}

absl::StatusOr<Calibration> Estimate(const Recording& recording) {
  std::vector<optimization::PhotometricObservation> observations;
  observations.reserve(recording.samples.size());
  for (const image::PhotometricSample& s : recording.samples) {
    observations.push_back({s.point, s.frame, s.radius, s.intensity, s.sigma_gray});
  }
  Calibration calibration;
  calibration.exposures_known = !recording.exposure_s.empty() && recording.exposure_s.front() > 0.0;
  absl::StatusOr<optimization::PhotometricAdjustmentResult> result =
      optimization::AdjustPhotometry(observations, recording.exposure_s);
  if (!result.ok()) {
    return absl::Status(result.status().code(),
                        absl::StrCat(result.status().message(), "; ", recording.times_ns.size(),
                                     " images were sampled. The camera must move, by little between two images"));
  }
  calibration.result = *std::move(result);
  calibration.coverage = Cover(recording, calibration.result.log_exposure);
  if (!calibration.exposures_known) {
    calibration.exposures = ExposuresOfAll(recording, calibration.result.log_exposure);
  }
  return calibration;
}

// Of the whole image, 1 where it is brightest.
cv::Mat VignetteImage(const optimization::PhotometricModel& model, cv::Size size) {
  cv::Mat vignette(size, CV_32FC1);
  const double half_diagonal = 0.5 * std::hypot(size.width - 1.0, size.height - 1.0);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const double radius = std::hypot(x - 0.5 * (size.width - 1), y - 0.5 * (size.height - 1)) / half_diagonal;
      vignette.at<float>(y, x) = static_cast<float>(model.Vignette(std::min(radius, 1.0)));
    }
  }
  double brightest = 1.0;
  cv::minMaxLoc(vignette, nullptr, &brightest);
  return vignette / brightest;
}

absl::Status Draw(const CalibrateOptions& options, const Recording& recording, const Calibration& calibration) {
  plot::PhotometricFigure figure;
  figure.title = recording.info.name;
  figure.inverse_response = calibration.result.model.InverseResponse();
  for (int i = 0; i <= 100; ++i) figure.vignette.push_back(calibration.result.model.Vignette(i / 100.0));
  figure.intensity_seen.assign(256, 0);
  for (const image::PhotometricSample& s : recording.samples) {
    ++figure.intensity_seen[static_cast<std::size_t>(std::clamp(s.intensity, 0.0, 255.0))];
  }
  plot::FigureOptions figure_options;
  figure_options.overwrite = true;
  return plot::WritePhotometricFigure(figure, options.picture, figure_options);
}

void Report(const CalibrateOptions& options, const Recording& recording, const Calibration& calibration,
            double elapsed_s) {
  const auto& result = calibration.result;
  const double corner = result.model.Vignette(1.0);
  if (options.json) {
    PrintJson({{"folder", options.out},
               {"images", recording.all_times_ns.size()},
               {"images_sampled", recording.times_ns.size()},
               {"images_skipped", recording.skipped},
               {"points", result.points},
               {"observations", result.observations},
               {"inlier_share", result.inlier_share},
               {"rms_gray", result.rms_gray},
               {"exposures", calibration.exposures_known ? "known" : "estimated"},
               {"exposure_ratio", calibration.coverage.exposure_ratio},
               {"intensity_coverage", calibration.coverage.intensity},
               {"radius_coverage", calibration.coverage.radius},
               {"path_share", recording.path_share},
               {"response_sigma", result.response_sigma},
               {"vignette_sigma", result.vignette_sigma},
               {"vignette_at_corner", corner},
               {"elapsed_s", elapsed_s}});
    return;
  }
  std::cout << absl::StrFormat(
      "%s: pcalib.txt (known to %.2f %% of full scale), vignette.png (%.2f +- %.2f in the corners)%s\n"
      "%d points in %d images, %.2f gray levels root mean square; exposures %s, 1:%.2f; %.0f %% of the intensities and "
      "%.0f %% of the radii seen\n",
      options.out, 100.0 * result.response_sigma, corner, result.vignette_sigma,
      calibration.exposures_known ? "" : ", times.txt", result.points, recording.times_ns.size(), result.rms_gray,
      calibration.exposures_known ? "known" : "estimated (response, vignette and exposures up to a common power)",
      calibration.coverage.exposure_ratio, 100.0 * calibration.coverage.intensity, 100.0 * calibration.coverage.radius);
}

absl::Status CheckOutputs(const CalibrateOptions& options) {
  CAIRN_RETURN_IF_ERROR(CheckWritable(options.picture, options.overwrite));
  CAIRN_RETURN_IF_ERROR(CheckPicture(options.picture));
  std::error_code error;
  if (fs::equivalent(options.out, options.input.sequence, error)) {
    return absl::InvalidArgumentError(
        absl::StrCat(options.out, " is the sequence itself: give the calibration a folder of its own"));
  }
  const std::vector<std::string> folders = {options.input.sequence, options.input.open.photometric_path};
  std::vector<std::string> outputs = {options.picture}, inputs = InputFiles(options.input);
  for (const std::string& name : io::PhotometricFileNames()) {
    outputs.push_back((fs::path(options.out) / name).string());
    for (const std::string& folder : folders) {
      if (!folder.empty()) inputs.push_back((fs::path(folder) / name).string());
    }
    CAIRN_RETURN_IF_ERROR(fs::is_directory(options.out, error) ? CheckWritable(outputs.back(), options.overwrite)
                                                               : absl::OkStatus());
  }
  // A calibration may stand in a folder of its own within the sequence.
  std::erase_if(inputs, [&](const std::string& input) { return fs::is_directory(input, error); });
  CAIRN_RETURN_IF_ERROR(CheckDistinct(outputs, inputs));
  return CheckDistinct({options.picture}, InputFiles(options.input));
}

absl::Status Calibrate(const CalibrateOptions& options, InterruptWatch* interrupt) {
  CAIRN_RETURN_IF_ERROR(CheckOutputs(options));
  const auto start = std::chrono::steady_clock::now();
  CAIRN_ASSIGN_OR_RETURN(const Recording recording, Record(options, interrupt));
  CAIRN_ASSIGN_OR_RETURN(const Calibration calibration, Estimate(recording));
  CAIRN_RETURN_IF_ERROR(CheckDetermined(recording, calibration));
  std::error_code error;
  fs::create_directories(options.out, error);
  if (error) return absl::UnavailableError(absl::StrCat("cannot make the folder ", options.out, ": ", error.message()));
  const cv::Size size(recording.info.camera.width_px, recording.info.camera.height_px);
  const optimization::PhotometricModel& model = calibration.result.model;
  CAIRN_RETURN_IF_ERROR(io::SavePhotometricFolder(options.out, model.InverseResponse(), VignetteImage(model, size),
                                                  calibration.exposures, options.overwrite));
  if (!options.picture.empty()) CAIRN_RETURN_IF_ERROR(Draw(options, recording, calibration));
  Report(options, recording, calibration,
         std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  return absl::OkStatus();
}

}  // namespace

void AddCameraCommand(CLI::App& app, Action* action) {
  CLI::App* camera = app.add_subcommand("camera", "Calibrate a camera");
  camera->require_subcommand(1);
  CLI::App* verb = camera->add_subcommand("calibrate-photometric",
                                          "Response, vignette and exposures from an ordinary sequence with motion");
  auto options = std::make_shared<CalibrateOptions>();
  AddInputOptions(verb, &options->input);
  verb->add_option("--out", options->out,
                   "Folder for pcalib.txt, vignette.png and, if exposures are estimated, times.txt")
      ->required();
  verb->add_option("--plot", options->picture, "Draw response and vignette into this .png or .svg");
  verb->add_option("--max-frames", options->max_frames,
                   "Images of which intensities are taken, spread over the sequence")
      ->check(CLI::Range(20, 2000))
      ->capture_default_str();
  verb->add_flag("--ignore-exposures", options->ignore_exposures, "Estimate the exposures even if they are known");
  verb->add_flag("--overwrite", options->overwrite, "Replace a calibration in the folder");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "Example:\n"
      "  cairn camera calibrate-photometric V1_01_easy --out left --plot left.png\n"
      "  cairn run V1_01_easy --photometric left --map room.cairn");
  verb->callback([=] {
    *action = [=] {
      InterruptWatch interrupt;
      const absl::Status status = Calibrate(*options, &interrupt);
      const int code = status.ok() ? static_cast<int>(kOk) : Fail(kCalibrateVerb, status, options->json);
      return interrupt.exit_code() != 0 ? interrupt.exit_code() : code;
    };
  });
}

}  // namespace cairn::cli

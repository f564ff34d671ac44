#include "io/image_treatment.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "absl/strings/str_format.h"
#include "io/atomic_file.h"
#include "io/frame_source.h"
#include "io/image_codecs.h"

namespace cairn::io {
namespace {

// Few images say nothing of what stays and what moves; of large ones reading takes its time.
constexpr std::size_t kFewImages = 30;
constexpr int kSamples = 24, kSamplesOfLarge = 12;
constexpr std::int64_t kLarge_px = 4'000'000;
constexpr double kLeastFixed = 0.05;  // of the view; less does little harm

// As it is in the file; nothing if it cannot be used.
std::optional<cv::Mat> Decode(const std::string& path, cv::Size size) {
  const absl::StatusOr<std::string> bytes = ReadWholeFile(path);
  if (!bytes.ok()) return std::nullopt;
  absl::StatusOr<cv::Mat> image = DecodeGray(*bytes);
  if (!image.ok() || image->size() != size) return std::nullopt;
  return *std::move(image);
}

std::vector<std::size_t> Spread(std::size_t count, int samples) {
  std::vector<std::size_t> indices;
  for (int i = 0; i < samples; ++i) {
    const std::size_t index = count * static_cast<std::size_t>(2 * i + 1) / static_cast<std::size_t>(2 * samples);
    if (indices.empty() || indices.back() != index) indices.push_back(index);
  }
  return indices;
}

const char* Side(const cv::Mat& mask) {
  const cv::Moments moments = cv::moments(mask == 0, true);
  if (moments.m00 <= 0.0) return "";
  const double x = moments.m10 / moments.m00 / mask.cols - 0.5, y = moments.m01 / moments.m00 / mask.rows - 0.5;
  if (std::max(std::abs(x), std::abs(y)) < 0.2) return "";
  if (std::abs(x) > std::abs(y)) return x < 0 ? " (at the left)" : " (at the right)";
  return y < 0 ? " (at the top)" : " (at the bottom)";
}

void TellOf(const image::ViewSurvey& survey, std::vector<std::string>* notes) {
  if (survey.interlaced) {
    notes->push_back(absl::StrCat("the images are interlaced, two half pictures of different times woven into one: ",
                                  "the second is left out"));
  }
  if (survey.bands.amplitude > 0.0) {
    notes->push_back(absl::StrFormat(
        "bands of light run over the images, about %.0f %% of their brightness from one to the next (lamps that "
        "flicker "
        "with the mains, and a rolling shutter): they are evened out, which costs accuracy; expose for whole periods "
        "of the "
        "mains",
        100.0 * survey.bands.amplitude));
  }
}

}  // namespace

void ImageTreatment::Apply(cv::Mat* raw) const {
  ToEightBits(range, raw);
  if (drop_second_field) image::DropSecondField(raw);
  if (band_periods > 0.0) image::EvenOutBands(band_periods, raw);
  hidden.Fill(raw);
}

absl::StatusOr<image::MaskFiller> LoadMask(const std::string& path, cv::Size size) {
  CAIRN_ASSIGN_OR_RETURN(const cv::Mat gray, ReadGrayImage(path, size));
  const cv::Mat mask = gray >= 128;
  constexpr double kLeastShown = 0.1;
  const double shown = static_cast<double>(cv::countNonZero(mask)) / static_cast<double>(mask.total());
  if (shown < kLeastShown) {
    return absl::InvalidArgumentError(
        absl::StrFormat("the mask %s shows %.1f %% of the view; black hides, white shows: is it the other way round?",
                        path, 100.0 * shown));
  }
  return image::MaskFiller(mask);
}

absl::StatusOr<ImageTreatment> FindTreatment(const std::vector<std::string>& paths, cv::Size size,
                                             const std::string& mask_path, std::vector<std::string>* notes) {
  ImageTreatment treatment;
  const bool look_for_fixed = mask_path.empty();
  if (!look_for_fixed && mask_path != "none") {
    CAIRN_ASSIGN_OR_RETURN(treatment.hidden, LoadMask(mask_path, size));
  }
  const int samples = std::int64_t{size.width} * size.height > kLarge_px ? kSamplesOfLarge : kSamples;
  const std::vector<std::size_t> indices = Spread(paths.size(), samples);
  IntensityStatistics intensities;
  for (const std::size_t index : indices) {
    const std::optional<cv::Mat> image = Decode(paths[index], size);
    if (image && image->depth() != CV_16U) break;  // so are the others
    if (image) intensities.Add(*image);
  }
  treatment.range = intensities.Range();
  if (const std::string what = treatment.range.Describe(); !what.empty()) notes->push_back(what);
  if (paths.size() < kFewImages) return treatment;
  image::ViewSurveyor surveyor;
  for (std::size_t i = 0; i < indices.size(); ++i) {
    std::optional<cv::Mat> image = Decode(paths[indices[i]], size), next;
    if (!image) continue;
    if (i % 2 == 0 && indices[i] + 1 < paths.size()) next = Decode(paths[indices[i] + 1], size);
    ToEightBits(treatment.range, &*image);
    if (next) ToEightBits(treatment.range, &*next);
    surveyor.Add(*image, next.value_or(cv::Mat()));
  }
  const image::ViewSurvey survey = surveyor.Result();
  treatment.drop_second_field = survey.interlaced;
  treatment.band_periods = survey.bands.periods;
  TellOf(survey, notes);
  if (look_for_fixed && survey.fixed_share >= kLeastFixed) {
    notes->push_back(
        absl::StrFormat("%.0f %% of the view%s does not move with the scene: taken to be fixed to the camera, and left "
                        "out (--mask none "
                        "uses it, --mask FILE says what to leave out)",
                        100.0 * survey.fixed_share, Side(survey.mask)));
    treatment.hidden = image::MaskFiller(survey.mask);
  }
  return treatment;
}

}  // namespace cairn::io

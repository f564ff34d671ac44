#include "io/frame_source.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <mutex>
#include <thread>
#include <utility>

#include "base/bounded_queue.h"
#include "base/files.h"
#include "base/guarded.h"
#include "geometry/lens_plausibility.h"
#include "io/image_treatment.h"
#include "io/photometric_files.h"
#include "io/sequence_readers.h"

namespace cairn::io {
namespace {

namespace fs = std::filesystem;

struct Format {
  SequenceFormat format;
  absl::string_view name;
  absl::string_view looked_for;
  bool (*looks_like)(const fs::path&, const OpenOptions&);
  absl::StatusOr<SequenceFiles> (*read)(const fs::path&, const OpenOptions&);
};

constexpr std::array<Format, 6> kFormats = {{
    {SequenceFormat::kEuroc, "euroc", "mav0/cam0/data.csv, cam0/data.csv or data.csv with sensor.yaml", LooksLikeEuroc,
     ReadEuroc},
    {SequenceFormat::kTumRgbd, "tum_rgbd", "rgb.txt", LooksLikeTumRgbd, ReadTumRgbd},
    {SequenceFormat::kTumMono, "tum_mono", "times.txt with camera.txt", LooksLikeTumMono, ReadTumMono},
    {SequenceFormat::kKitti, "kitti", "times.txt with image_0/ and calib.txt", LooksLikeKitti, ReadKitti},
    {SequenceFormat::kTimes, "times", "times.txt with camera.yaml", LooksLikeTimes, ReadTimes},
    {SequenceFormat::kImages, "images", "image files, or images/, with camera.yaml", LooksLikeImages, ReadImages},
}};

absl::StatusOr<const Format*> FindFormat(const fs::path& folder, const OpenOptions& options) {
  std::string looked_for;
  for (const Format& format : kFormats) {
    if (options.format == format.format) return &format;
    if (options.format == SequenceFormat::kAuto && format.looks_like(folder, options)) return &format;
    absl::StrAppend(&looked_for, looked_for.empty() ? "" : "; ", format.looked_for, " (", format.name, ")");
  }
  return absl::NotFoundError(
      absl::StrCat(folder.string(), " holds no sequence that is known here; looked for ", looked_for));
}

double MedianRateHz(const std::vector<ListedImage>& images) {
  if (images.size() < 2) return 0.0;
  std::vector<TimeNs> steps;
  for (std::size_t i = 1; i < images.size(); ++i) steps.push_back(images[i].time_ns - images[i - 1].time_ns);
  std::nth_element(steps.begin(), steps.begin() + steps.size() / 2, steps.end());
  return 1.0 / ToSeconds(steps[steps.size() / 2]);
}

struct SelectedImage {
  std::int64_t sequence_index;
  ListedImage image;
};

absl::StatusOr<std::vector<SelectedImage>> Select(const std::vector<ListedImage>& images, const OpenOptions& options) {
  std::vector<SelectedImage> selected;
  const TimeNs first_ns = images.front().time_ns;
  const TimeNs from_ns = FromSeconds(options.from_s);
  std::int64_t passed = 0;
  for (std::size_t i = 0; i < images.size(); ++i) {
    const TimeNs since_ns = images[i].time_ns - first_ns;
    if (since_ns < from_ns) continue;
    if (options.until_s < 9e9 && since_ns >= FromSeconds(options.until_s)) break;
    if (passed++ % options.stride == 0) selected.push_back({static_cast<std::int64_t>(i), images[i]});
  }
  if (selected.empty()) {
    const std::string until = options.until_s < 9e9 ? absl::StrCat(" until before ", options.until_s, " s") : " on";
    return absl::OutOfRangeError(absl::StrCat("no image lies from ", options.from_s, " s", until,
                                              "; the sequence lasts ", ToSeconds(images.back().time_ns - first_ns),
                                              " s"));
  }
  return selected;
}

// The calibration of another folder, with its exposures if it has any: those of images of the same time.
absl::Status GivePhotometric(const std::string& folder, SequenceFiles* files) {
  CAIRN_ASSIGN_OR_RETURN(PhotometricFolder given, LoadPhotometricFolder(folder));
  CAIRN_RETURN_IF_ERROR(Annotate(given.calibration.ValidateFor(files->camera), folder));
  files->photometric = std::move(given.calibration);
  if (!given.exposures) return absl::OkStatus();
  auto at = given.exposures->begin();
  for (ListedImage& image : files->images) {
    while (at != given.exposures->end() && at->first < image.time_ns) ++at;
    image.exposure_s = at != given.exposures->end() && at->first == image.time_ns ? at->second : 0.0;
  }
  return absl::OkStatus();
}

// An image that is there and readable must have the calibration's size; a folder without any of its images is no
// sequence.
absl::Status CheckFirstImages(const std::vector<SelectedImage>& selected, const Camera& camera) {
  const cv::Size size(camera.width_px, camera.height_px);
  for (const SelectedImage& candidate : selected) {
    if (!IsFile(candidate.image.path)) continue;
    const absl::Status status = ReadGrayImage(candidate.image.path, size).status();
    return absl::IsInvalidArgument(status) ? status : absl::OkStatus();
  }
  return absl::NotFoundError(absl::StrCat("none of the ", selected.size(), " listed images is there, the first being ",
                                          selected.front().image.path));
}

// Memory that runs out is no fault of the image, and ends the sequence.
absl::StatusOr<SourceFrame> Load(const SelectedImage& selected, std::int64_t index, cv::Size size,
                                 const ImageTreatment& treatment) {
  SourceFrame frame;
  frame.index = index;
  frame.sequence_index = selected.sequence_index;
  frame.time_ns = selected.image.time_ns;
  frame.path = selected.image.path;
  frame.exposure_s = selected.image.exposure_s;
  absl::StatusOr<cv::Mat> gray = Guarded([&]() -> absl::StatusOr<cv::Mat> {
    CAIRN_ASSIGN_OR_RETURN(cv::Mat image, ReadDeepImage(selected.image.path, size));
    treatment.Apply(&image);
    return image;
  });
  if (absl::IsResourceExhausted(gray.status())) return Annotate(gray.status(), selected.image.path);
  frame.status = gray.status();
  if (gray.ok()) frame.gray = *std::move(gray);
  return frame;
}

// Images listed in files, decoded ahead by one thread, in order.
class ListedFrameSource : public FrameSource {
 public:
  static absl::StatusOr<std::unique_ptr<FrameSource>> Create(SourceInfo info, std::vector<SelectedImage> images,
                                                             ImageTreatment treatment, int prefetch) {
    auto source =
        std::make_unique<ListedFrameSource>(std::move(info), std::move(images), std::move(treatment), prefetch);
    if (prefetch > 0) {
      ListedFrameSource* const self = source.get();
      CAIRN_ASSIGN_OR_RETURN(source->thread_, StartThread(
                                                  "reading images", [self] { self->DecodeAhead(); },
                                                  [self](const absl::Status& status) { self->End(status); }));
    }
    return std::unique_ptr<FrameSource>(std::move(source));
  }
  ListedFrameSource(SourceInfo info, std::vector<SelectedImage> images, ImageTreatment treatment, int prefetch)
      : info_(std::move(info)),
        images_(std::move(images)),
        treatment_(std::move(treatment)),
        queue_(static_cast<std::size_t>(std::max(prefetch, 1))) {}
  ~ListedFrameSource() override {
    queue_.Close();
    if (thread_.joinable()) thread_.join();
  }
  ListedFrameSource(const ListedFrameSource&) = delete;
  ListedFrameSource& operator=(const ListedFrameSource&) = delete;

  const SourceInfo& info() const override { return info_; }

  absl::StatusOr<std::optional<SourceFrame>> Next() override {
    return Guarded([&]() -> absl::StatusOr<std::optional<SourceFrame>> {
      if (thread_.joinable()) {
        std::optional<SourceFrame> frame = queue_.Pop();
        if (frame) return frame;
        std::lock_guard lock(mutex_);
        if (!status_.ok()) return status_;
        return std::optional<SourceFrame>();
      }
      if (next_ == images_.size()) return std::optional<SourceFrame>();
      CAIRN_ASSIGN_OR_RETURN(SourceFrame frame, LoadAt(next_++));
      return std::optional<SourceFrame>(std::move(frame));
    });
  }

 private:
  absl::StatusOr<SourceFrame> LoadAt(std::size_t i) const {
    return Load(images_[i], static_cast<std::int64_t>(i), {info_.camera.width_px, info_.camera.height_px}, treatment_);
  }
  void DecodeAhead() {
    for (std::size_t i = 0; i < images_.size(); ++i) {
      absl::StatusOr<SourceFrame> frame = LoadAt(i);
      if (!frame.ok()) return End(frame.status());
      if (!queue_.Push(*std::move(frame))) return;
    }
    End(absl::OkStatus());
  }
  // What is queued still comes, then the error, if it is one.
  void End(const absl::Status& status) {
    {
      std::lock_guard lock(mutex_);
      status_ = status;
    }
    queue_.Close();
  }

  const SourceInfo info_;
  const std::vector<SelectedImage> images_;
  const ImageTreatment treatment_;
  std::size_t next_ = 0;
  BoundedQueue<SourceFrame> queue_;
  std::mutex mutex_;  // guards status_
  absl::Status status_;
  std::thread thread_;
};

std::string NameOf(const std::string& path) {
  std::error_code error;
  const fs::path whole = fs::weakly_canonical(path, error);
  return error || whole.filename().empty() ? path : whole.filename().string();
}

}  // namespace

absl::string_view SequenceFormatName(SequenceFormat format) {
  for (const Format& known : kFormats) {
    if (known.format == format) return known.name;
  }
  return "auto";
}

absl::StatusOr<SequenceFormat> SequenceFormatFromName(absl::string_view name) {
  if (name == "auto") return SequenceFormat::kAuto;
  std::string names = "auto";
  for (const Format& known : kFormats) {
    if (known.name == name) return known.format;
    absl::StrAppend(&names, ", ", known.name);
  }
  return absl::InvalidArgumentError(absl::StrCat("unknown sequence format \"", name, "\"; use one of ", names));
}

absl::Status OpenOptions::Validate() const {
  if (!(from_s >= 0.0 && from_s < 9e9)) {
    return absl::InvalidArgumentError(absl::StrCat("from is ", from_s, " s but must not be negative"));
  }
  if (!(until_s > from_s)) {
    return absl::InvalidArgumentError(
        absl::StrCat("until is ", until_s, " s but must be later than from, ", from_s, " s"));
  }
  if (stride < 1) return absl::InvalidArgumentError(absl::StrCat("stride is ", stride, " but must be at least 1"));
  if (camera_index < -1 || camera_index > 15) {
    return absl::InvalidArgumentError(absl::StrCat("camera index is ", camera_index, " but must be in 0 to 15"));
  }
  if (prefetch < 0 || prefetch > 10000) {
    return absl::InvalidArgumentError(absl::StrCat("prefetch is ", prefetch, " images but must be in 0 to 10000"));
  }
  return absl::OkStatus();
}

namespace {

absl::StatusOr<std::unique_ptr<FrameSource>> OpenFolder(const std::string& path, const OpenOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  if (!IsFolder(path)) {
    const std::string kind = IsFile(path) ? "is a file" : WhyNoFile(path);
    return absl::NotFoundError(kind.empty() ? absl::StrCat("there is no folder ", path)
                                            : absl::StrCat(path, " ", kind, "; give the folder of the sequence"));
  }
  CAIRN_ASSIGN_OR_RETURN(const Format* const format, FindFormat(path, options));
  const bool several_cameras = format->format == SequenceFormat::kEuroc || format->format == SequenceFormat::kKitti;
  if (options.camera_index > 0 && !several_cameras) {
    return absl::InvalidArgumentError(absl::StrCat("camera index is ", options.camera_index, " but ", path,
                                                   " is of format ", format->name,
                                                   ", which has one camera: leave the index out"));
  }
  CAIRN_ASSIGN_OR_RETURN(SequenceFiles files, format->read(path, options));
  CAIRN_RETURN_IF_ERROR(Annotate(files.camera.Validate(), path));
  if (!options.photometric_path.empty()) {
    CAIRN_RETURN_IF_ERROR(GivePhotometric(options.photometric_path, &files));
  } else if (files.photometric) {
    CAIRN_RETURN_IF_ERROR(Annotate(files.photometric->ValidateFor(files.camera), path));
  }
  absl::StatusOr<std::vector<SelectedImage>> selected = Select(files.images, options);
  if (!selected.ok()) return Annotate(selected.status(), path);
  CAIRN_RETURN_IF_ERROR(CheckFirstImages(*selected, files.camera));
  SourceInfo info;
  info.name = NameOf(path);
  info.format = format->format;
  info.num_frames = static_cast<std::int64_t>(selected->size());
  info.camera = files.camera;
  info.rate_hz = files.rate_hz > 0.0 ? files.rate_hz : MedianRateHz(files.images);
  info.first_time_ns = selected->front().image.time_ns;
  info.last_time_ns = selected->back().image.time_ns;
  info.duration_s = ToSeconds(info.last_time_ns - info.first_time_ns);
  info.photometric = std::move(files.photometric);
  info.body_from_camera = files.body_from_camera;
  info.notes = std::move(files.notes);
  if (std::string unusual = UnusualLens(info.camera); !unusual.empty()) info.notes.push_back(std::move(unusual));
  std::vector<std::string> paths;
  for (const SelectedImage& image : *selected) paths.push_back(image.image.path);
  CAIRN_ASSIGN_OR_RETURN(ImageTreatment treatment, FindTreatment(paths, {info.camera.width_px, info.camera.height_px},
                                                                 options.mask_path, &info.notes));
  return ListedFrameSource::Create(std::move(info), *std::move(selected), std::move(treatment), options.prefetch);
}

}  // namespace

absl::StatusOr<std::unique_ptr<FrameSource>> FrameSource::Open(const std::string& path, const OpenOptions& options) {
  return Guarded([&] { return OpenFolder(path, options); });
}

}  // namespace cairn::io

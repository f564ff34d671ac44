// One interface over every kind of image sequence. docs/input.md describes the formats for users.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "base/status.h"
#include "base/time.h"
#include "geometry/camera.h"
#include "geometry/se3.h"
#include "image/photometric.h"

namespace cairn::io {

enum class SequenceFormat { kAuto, kEuroc, kTumRgbd, kTumMono, kKitti, kTimes, kImages };

// "auto", "euroc", "tum_rgbd", "tum_mono", "kitti", "times", "images".
absl::string_view SequenceFormatName(SequenceFormat format);
absl::StatusOr<SequenceFormat> SequenceFormatFromName(absl::string_view name);

struct OpenOptions {
  std::string camera_path;       // a camera.yaml to use instead of the sequence's own calibration
  std::string photometric_path;  // a folder with pcalib.txt, vignette.png, times.txt to use instead of the sequence's
  // An image of the size of the others, black where the view is to be left out. Empty: what is fixed to the camera is
  // looked for in samples of the sequence; "none": nothing is left out.
  std::string mask_path;
  SequenceFormat format = SequenceFormat::kAuto;
  int camera_index = -1;  // which of several cameras: EuRoC cam0, cam1; KITTI image_0..3; -1: the first that there is
  double from_s = 0.0;    // seconds from the first image, inclusive
  double until_s = std::numeric_limits<double>::infinity();  // likewise, exclusive
  int stride = 1;                                            // every stride-th of the images from from_s on
  int prefetch = 8;  // images decoded ahead by a thread; 0: decode inside Next()

  absl::Status Validate() const;
};

struct SourceInfo {
  std::string name;  // last part of the path
  SequenceFormat format = SequenceFormat::kAuto;
  std::int64_t num_frames = 0;  // that Next() will deliver, unreadable ones included
  Camera camera;                // of the raw images
  double rate_hz = 0.0;         // nominal; if the files do not say, from the median interval; 0: one image
  TimeNs first_time_ns = 0;     // of the frames that will be delivered
  TimeNs last_time_ns = 0;
  double duration_s = 0.0;  // between those two
  std::optional<image::PhotometricCalibration> photometric;
  std::optional<SE3> body_from_camera;  // EuRoC's T_BS
  // What was understood of the files that is not as usual, for people: units, names, what was left out, scales.
  std::vector<std::string> notes;
};

struct SourceFrame {
  std::int64_t index = 0;           // counts what Next() delivers, from 0
  std::int64_t sequence_index = 0;  // counts all images of the sequence, from 0, whatever from_s and stride
  TimeNs time_ns = 0;
  std::string path;
  // CV_8UC1, raw: distorted, photometrically uncorrected, but for what image_treatment.h does; empty if !status.ok()
  cv::Mat gray;
  double exposure_s = 0.0;  // 0: unknown
  // Why this image could not be used (missing, truncated, corrupt, of another size than the calibration). The sequence
  // goes on; callers count and skip.
  absl::Status status;
};

class FrameSource {
 public:
  virtual ~FrameSource() = default;

  // `path` is a folder. NotFound or InvalidArgument names the file, the line and the remedy; an unrecognized folder
  // lists what was looked for. The lists and calibrations are read here, whole; the images later.
  static absl::StatusOr<std::unique_ptr<FrameSource>> Open(const std::string& path, const OpenOptions& options = {});

  virtual const SourceInfo& info() const = 0;

  // The next frame, in temporal order; nothing after the last. An error only if the source itself breaks. One caller at
  // a time.
  virtual absl::StatusOr<std::optional<SourceFrame>> Next() = 0;
};

// Decodes an image file to CV_8UC1: colour to gray, 16 bits to 8 by the range that it fills (intensity_range.h), EXIF
// rotation ignored. NotFound, DataLoss (truncated, corrupt) or InvalidArgument (another size than `expected`, unless
// that is empty) name the file.
absl::StatusOr<cv::Mat> ReadGrayImage(const std::string& path, cv::Size expected = {});
// The same with 16 bits as they are.
absl::StatusOr<cv::Mat> ReadDeepImage(const std::string& path, cv::Size expected = {});

}  // namespace cairn::io

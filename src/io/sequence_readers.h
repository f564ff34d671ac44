// The readers of the sequence formats, each in its own file: they turn a folder into a list of images and a
// calibration. Only frame_source.cc calls them.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/status.h"
#include "io/camera_file.h"
#include "io/frame_source.h"

namespace cairn::io {

struct ListedImage {
  TimeNs time_ns = 0;
  std::string path;
  double exposure_s = 0.0;  // 0: unknown
};

struct SequenceFiles {
  std::vector<ListedImage> images;  // times increase strictly
  Camera camera;
  double rate_hz = 0.0;  // 0: not said
  std::optional<image::PhotometricCalibration> photometric;
  std::optional<SE3> body_from_camera;
  std::vector<std::string> notes;  // what was understood that is not as usual, for people
};

// Whether a folder has what tells the format from the others. The first that says yes, in this order, is taken.
bool LooksLikeEuroc(const std::filesystem::path& folder, const OpenOptions& options);
bool LooksLikeTumRgbd(const std::filesystem::path& folder, const OpenOptions& options);
bool LooksLikeTumMono(const std::filesystem::path& folder, const OpenOptions& options);
bool LooksLikeKitti(const std::filesystem::path& folder, const OpenOptions& options);
bool LooksLikeTimes(const std::filesystem::path& folder, const OpenOptions& options);
bool LooksLikeImages(const std::filesystem::path& folder, const OpenOptions& options);

absl::StatusOr<SequenceFiles> ReadEuroc(const std::filesystem::path& folder, const OpenOptions& options);
absl::StatusOr<SequenceFiles> ReadTumRgbd(const std::filesystem::path& folder, const OpenOptions& options);
absl::StatusOr<SequenceFiles> ReadTumMono(const std::filesystem::path& folder, const OpenOptions& options);
absl::StatusOr<SequenceFiles> ReadKitti(const std::filesystem::path& folder, const OpenOptions& options);
absl::StatusOr<SequenceFiles> ReadTimes(const std::filesystem::path& folder, const OpenOptions& options);
absl::StatusOr<SequenceFiles> ReadImages(const std::filesystem::path& folder, const OpenOptions& options);

// Shared by the readers:

bool IsFile(const std::filesystem::path& path);
bool IsFolder(const std::filesystem::path& path);

// The calibration of formats that have none of their own: options.camera_path or camera.yaml in the folder.
absl::StatusOr<CameraFile> GivenCamera(const std::filesystem::path& folder, const OpenOptions& options);

// Lines of `seconds filename` (TUM RGB-D's rgb.txt, times.txt); file names are relative to the list's folder. Also with
// times in other units, quotes, backslashes, or the folders of another machine in front; `out->notes` tells. The rate
// of `out` is that of the camera file.
absl::Status ReadTimedList(const std::filesystem::path& list, SequenceFiles* out);

// The names of the image files in a folder, in natural order (image_series.h); empty if there is no such folder.
std::vector<std::string> ImageNamesIn(const std::filesystem::path& folder);

// The camera to read: the one that was asked for, or the first that `there_is`.
int ChooseCamera(const OpenOptions& options, const std::function<bool(int)>& there_is);
constexpr int kMaxCameras = 16;

}  // namespace cairn::io

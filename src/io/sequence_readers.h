// The readers of the sequence formats, each in its own file: they turn a folder into a list of images and a
// calibration. Only frame_source.cc calls them.
#pragma once

#include <filesystem>
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

// Lines of `seconds filename` (TUM RGB-D's rgb.txt, times.txt); file names are relative to the list's folder.
absl::StatusOr<std::vector<ListedImage>> ReadTimedList(const std::filesystem::path& list);

// The names of the image files in a folder, in the order of their bytes; empty if there is no such folder.
std::vector<std::string> ImageNamesIn(const std::filesystem::path& folder);

}  // namespace cairn::io

#include "io/sequence_readers.h"

#include <algorithm>
#include <array>

#include "absl/strings/ascii.h"
#include "io/text_lines.h"
#include "io/time_text.h"

namespace cairn::io {

namespace fs = std::filesystem;

bool IsFile(const fs::path& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored);
}

bool IsFolder(const fs::path& path) {
  std::error_code ignored;
  return fs::is_directory(path, ignored);
}

absl::StatusOr<CameraFile> GivenCamera(const fs::path& folder, const OpenOptions& options) {
  if (!options.camera_path.empty()) return LoadCamera(options.camera_path);
  const fs::path own = folder / "camera.yaml";
  if (IsFile(own)) return LoadCamera(own.string());
  return absl::NotFoundError(absl::StrCat("no calibration for ", folder.string(),
                                          ": there is no camera.yaml in it and none was given",
                                          " (--camera FILE); docs/input.md describes the file"));
}

absl::StatusOr<std::vector<ListedImage>> ReadTimedList(const fs::path& list) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<TextLine> lines, ReadDataLines(list.string()));
  std::vector<ListedImage> images;
  TimeOrder order;
  for (const TextLine& line : lines) {
    const absl::string_view text = line.text;
    const std::size_t blank = std::min(text.find_first_of(" \t,"), text.size());
    const absl::StatusOr<TimeNs> time_ns = ParseSeconds(text.substr(0, blank));
    if (!time_ns.ok()) return LineError(list.string(), line.number, time_ns.status().message());
    absl::string_view name = text.substr(blank);
    name.remove_prefix(std::min(name.find_first_not_of(" \t,"), name.size()));
    if (name.empty()) {
      return LineError(list.string(), line.number, "no file name; expected lines of `seconds filename`");
    }
    CAIRN_RETURN_IF_ERROR(order.Add(*time_ns, list.string(), line.number));
    images.push_back({*time_ns, (list.parent_path() / std::string(name)).string(), 0.0});
  }
  if (images.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(list.string(), " lists no images; expected lines of `seconds filename`"));
  }
  return images;
}

std::vector<std::string> ImageNamesIn(const fs::path& folder) {
  static constexpr std::array<absl::string_view, 9> kExtensions = {".png", ".jpg", ".jpeg", ".bmp", ".pgm",
                                                                   ".ppm", ".tif", ".tiff", ".webp"};
  std::vector<std::string> names;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename().string();
    const std::string extension = absl::AsciiStrToLower(it->path().extension().string());
    if (name[0] != '.' && std::find(kExtensions.begin(), kExtensions.end(), extension) != kExtensions.end()) {
      names.push_back(name);
    }
  }
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace cairn::io

// KITTI odometry folders (Geiger, Lenz, Urtasun, "Are we ready for autonomous driving?", CVPR 2012): image_N/000000.png
// ..., times.txt with one time a line, calib.txt with the rectified projection matrices P0 ... P3.
#include <algorithm>
#include <map>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "io/sequence_readers.h"
#include "io/text_lines.h"
#include "io/time_text.h"

namespace cairn::io {
namespace {

namespace fs = std::filesystem;

absl::StatusOr<Camera> ReadProjection(const std::string& path, int index) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<TextLine> lines, ReadDataLines(path));
  const std::string key = absl::StrCat("P", index, ":");
  for (const TextLine& line : lines) {
    const std::vector<absl::string_view> fields = SplitFields(line.text);
    if (fields[0] != key) continue;
    double p[12];
    bool numbers = fields.size() == 13;
    for (std::size_t i = 0; numbers && i < 12; ++i) numbers = absl::SimpleAtod(fields[i + 1], &p[i]);
    if (!numbers) return LineError(path, line.number, absl::StrCat(key, " must have 12 numbers, a 3x4 matrix"));
    Camera camera;
    camera.fx_px = p[0];
    camera.cx_px = p[2];
    camera.fy_px = p[5];
    camera.cy_px = p[6];
    return camera;
  }
  return absl::InvalidArgumentError(absl::StrCat(path, " has no line ", key, " for the camera ", index));
}

// The files do not say the size of the images: it is that of the first that can be read.
absl::StatusOr<cv::Size> SizeOf(const std::vector<ListedImage>& images) {
  absl::Status first_error;
  for (const ListedImage& image : images) {
    const absl::StatusOr<cv::Mat> gray = ReadGrayImage(image.path);
    if (gray.ok()) return gray->size();
    if (first_error.ok()) first_error = gray.status();
  }
  return Annotate(first_error, "no image can be read");
}

}  // namespace

bool LooksLikeKitti(const fs::path& folder, const OpenOptions& options) {
  return IsFile(folder / "times.txt") && (IsFolder(folder / absl::StrCat("image_", options.camera_index)) ||
                                          (IsFile(folder / "calib.txt") && IsFolder(folder / "image_0")));
}

absl::StatusOr<SequenceFiles> ReadKitti(const fs::path& folder, const OpenOptions& options) {
  const fs::path image_folder = folder / absl::StrCat("image_", options.camera_index);
  const std::string times_path = (folder / "times.txt").string();
  CAIRN_ASSIGN_OR_RETURN(const std::vector<TextLine> lines, ReadDataLines(times_path));
  const std::vector<std::string> names = ImageNamesIn(image_folder);
  if (lines.empty() || names.empty()) {
    return absl::NotFoundError(lines.empty() ? absl::StrCat(times_path, " holds no times")
                                             : absl::StrCat("no images in ", image_folder.string()));
  }
  std::map<std::string, std::string> name_of_stem;
  for (const std::string& name : names) name_of_stem[fs::path(name).stem().string()] = name;
  const std::string extension = fs::path(names[0]).extension().string();
  SequenceFiles out;
  TimeOrder order;
  std::size_t used = 0;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const absl::StatusOr<TimeNs> time_ns = ParseSeconds(SplitFields(lines[i].text)[0]);
    if (!time_ns.ok()) return LineError(times_path, lines[i].number, time_ns.status().message());
    CAIRN_RETURN_IF_ERROR(order.Add(*time_ns, times_path, lines[i].number));
    const std::string stem = absl::StrFormat("%06d", i);
    const auto found = name_of_stem.find(stem);
    used += found != name_of_stem.end() ? 1 : 0;
    const std::string name = found != name_of_stem.end() ? found->second : stem + extension;
    out.images.push_back({*time_ns, (image_folder / name).string(), 0.0});
  }
  if (used < names.size()) {
    return absl::InvalidArgumentError(absl::StrCat(image_folder.string(), " has ", names.size(), " images but ",
                                                   times_path, " times for ", used,
                                                   " of them; both must belong to one sequence"));
  }
  if (!options.camera_path.empty()) {
    CAIRN_ASSIGN_OR_RETURN(const CameraFile file, LoadCamera(options.camera_path));
    out.camera = file.camera;
    out.rate_hz = file.rate_hz;
    return out;
  }
  const std::string calib_path = (folder / "calib.txt").string();
  CAIRN_ASSIGN_OR_RETURN(out.camera, ReadProjection(calib_path, options.camera_index));
  CAIRN_ASSIGN_OR_RETURN(const cv::Size size, SizeOf(out.images));
  out.camera.width_px = size.width;
  out.camera.height_px = size.height;
  CAIRN_RETURN_IF_ERROR(Annotate(out.camera.Validate(), calib_path));
  return out;
}

}  // namespace cairn::io

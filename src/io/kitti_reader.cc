// KITTI odometry folders (Geiger, Lenz, Urtasun, "Are we ready for autonomous driving?", CVPR 2012): image_N/000000.png
// ..., times.txt with one time a line, calib.txt with the rectified projection matrices P0 ... P3.
#include <algorithm>
#include <map>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "io/sequence_readers.h"
#include "io/text_lines.h"
#include "io/time_column.h"

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

fs::path ImageFolder(const fs::path& folder, int index) { return folder / absl::StrCat("image_", index); }

int IndexIn(const fs::path& folder, const OpenOptions& options) {
  return ChooseCamera(options, [&](int index) { return IsFolder(ImageFolder(folder, index)); });
}

// A time a line, of which further columns are none of our business.
absl::Status ReadTimes(const std::string& path, const std::vector<std::string>& names, const fs::path& image_folder,
                       SequenceFiles* out) {
  CAIRN_ASSIGN_OR_RETURN(const TextTable table, ReadTable(path));
  if (table.lines.empty()) return absl::NotFoundError(absl::StrCat(path, " holds no times"));
  std::vector<TimeText> texts;
  for (const TextLine& line : table.lines) texts.push_back({line.number, SplitFields(line.text)[0]});
  TimeColumnRules rules;
  rules.rate_hz = out->rate_hz;
  rules.example = "# time [ms]";
  const std::vector<std::string> columns = ColumnNames(table.header);
  if (columns.size() == 1 && NamesTime(columns[0])) rules.named = UnitOfColumn(columns[0]);
  CAIRN_ASSIGN_OR_RETURN(const TimeColumn times, ReadTimeColumn(path, texts, rules));
  if (!times.note.empty()) out->notes.push_back(times.note);
  // The number of an image is its place, with whatever zeros in front.
  std::map<std::int64_t, std::string> name_of_number;
  for (const std::string& name : names) {
    std::int64_t number;
    if (absl::SimpleAtoi(fs::path(name).stem().string(), &number)) name_of_number[number] = name;
  }
  const std::string extension = fs::path(names[0]).extension().string();
  TimeOrder order;
  std::size_t used = 0;
  for (std::size_t i = 0; i < texts.size(); ++i) {
    CAIRN_RETURN_IF_ERROR(order.Add(times.times_ns[i], path, texts[i].line));
    const auto found = name_of_number.find(static_cast<std::int64_t>(i));
    used += found != name_of_number.end() ? 1 : 0;
    const std::string name = found != name_of_number.end() ? found->second : absl::StrFormat("%06d", i) + extension;
    out->images.push_back({times.times_ns[i], (image_folder / name).string(), 0.0});
  }
  if (used < names.size()) {
    return absl::InvalidArgumentError(absl::StrCat(image_folder.string(), " has ", names.size(), " images but ", path,
                                                   " times for ", used, " of them; both must belong to one sequence"));
  }
  return absl::OkStatus();
}

}  // namespace

bool LooksLikeKitti(const fs::path& folder, const OpenOptions& options) {
  if (!IsFile(folder / "times.txt")) return false;
  // Whichever was asked for: what there is makes the format.
  return IsFolder(ImageFolder(folder, IndexIn(folder, options))) || IsFolder(ImageFolder(folder, IndexIn(folder, {})));
}

absl::StatusOr<SequenceFiles> ReadKitti(const fs::path& folder, const OpenOptions& options) {
  const int index = IndexIn(folder, options);
  const fs::path image_folder = ImageFolder(folder, index);
  const std::vector<std::string> names = ImageNamesIn(image_folder);
  if (names.empty()) return absl::NotFoundError(absl::StrCat("no images in ", image_folder.string()));
  SequenceFiles out;
  const std::string calib_path = (folder / "calib.txt").string();
  const bool own = options.camera_path.empty() && (IsFile(calib_path) || !IsFile(folder / "camera.yaml"));
  if (!own) {
    CAIRN_ASSIGN_OR_RETURN(const CameraFile file, GivenCamera(folder, options));
    out.camera = file.camera;
    out.rate_hz = file.rate_hz;
  }
  CAIRN_RETURN_IF_ERROR(ReadTimes((folder / "times.txt").string(), names, image_folder, &out));
  if (options.camera_index < 0 && index != 0) {
    out.notes.push_back(absl::StrCat(folder.string(), ": there is no image_0/; image_", index, "/ is used",
                                     own ? absl::StrCat(", with P", index, " of calib.txt") : ""));
  }
  if (!own) return out;
  CAIRN_ASSIGN_OR_RETURN(out.camera, ReadProjection(calib_path, index));
  CAIRN_ASSIGN_OR_RETURN(const cv::Size size, SizeOf(out.images));
  out.camera.width_px = size.width;
  out.camera.height_px = size.height;
  CAIRN_RETURN_IF_ERROR(Annotate(out.camera.Validate(), calib_path));
  return out;
}

}  // namespace cairn::io

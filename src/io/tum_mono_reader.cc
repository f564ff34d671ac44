// TUM monoVO folders (Engel, Usenko, Cremers, "A photometrically calibrated benchmark for monocular visual odometry",
// 2016): camera.txt, times.txt with `id seconds exposure_ms`, images/, pcalib.txt, vignette.png. camera.txt is in the
// format that the data set and the README of DSO describe:
//   line 1  [FOV] fx fy cx cy omega | [RadTan] fx fy cx cy k1 k2 r1 r2 | EquiDistant fx fy cx cy k1 k2 k3 k4 | Pinhole
//   fx fy cx cy 0 line 2  width height, of the raw images lines 3 and 4, how that software rectifies, are not used.
// With cx < 1 and cy < 1 the intrinsics are relative to the size, pixel centres at half-integers:
//   fx width, fy height, cx width - 0.5, cy height - 0.5.
#include <algorithm>
#include <map>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "io/photometric_files.h"
#include "io/sequence_readers.h"
#include "io/text_lines.h"
#include "io/time_column.h"

namespace cairn::io {
namespace {

namespace fs = std::filesystem;

constexpr absl::string_view kCameraLine =
    "expected `fx fy cx cy omega`, or a name (FOV, RadTan, EquiDistant, KannalaBrandt, Pinhole) and its numbers";

// The model by its name, or without a name by the numbers.
absl::StatusOr<CameraModel> ModelOf(const std::string& name, const std::vector<double>& numbers) {
  const std::size_t n = numbers.size();
  const absl::Status wrong_count = absl::InvalidArgumentError(
      absl::StrCat(n, " numbers do not fit the camera", name.empty() ? "" : " " + name, "; ", kCameraLine));
  if (name.empty()) {
    if (n == 5) return numbers[4] == 0.0 ? CameraModel::kPinhole : CameraModel::kFov;
    if (n == 8) return CameraModel::kRadialTangential;
    return wrong_count;
  }
  if (name == "pinhole") {
    if (n == 4 || (n == 5 && numbers[4] == 0.0)) return CameraModel::kPinhole;
    return wrong_count;
  }
  if (name == "fov" || name == "atan") return n == 5 ? absl::StatusOr<CameraModel>(CameraModel::kFov) : wrong_count;
  if (name == "radtan") return n == 8 ? absl::StatusOr<CameraModel>(CameraModel::kRadialTangential) : wrong_count;
  if (name == "equidistant" || name == "kannalabrandt") {
    return n == 8 ? absl::StatusOr<CameraModel>(CameraModel::kKannalaBrandt) : wrong_count;
  }
  return absl::InvalidArgumentError(absl::StrCat("unknown camera `", name, "`; ", kCameraLine));
}

absl::StatusOr<Camera> ReadCameraText(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<TextLine> lines, ReadDataLines(path));
  if (lines.size() < 2) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, " must have a line with the camera and one with `width height`"));
  }
  std::vector<absl::string_view> fields = SplitFields(lines[0].text);
  std::string name;
  if (!fields[0].empty() && absl::ascii_isalpha(static_cast<unsigned char>(fields[0][0]))) {
    name = absl::AsciiStrToLower(fields[0]);
    if (!name.empty() && name.back() == ':') name.pop_back();
    fields.erase(fields.begin());
  }
  std::vector<double> numbers(fields.size());
  for (std::size_t i = 0; i < fields.size(); ++i) {
    if (!absl::SimpleAtod(fields[i], &numbers[i])) {
      return LineError(path, lines[0].number, absl::StrCat("\"", fields[i], "\" is not a number; ", kCameraLine));
    }
  }
  const absl::StatusOr<CameraModel> model = ModelOf(name, numbers);
  if (!model.ok()) return LineError(path, lines[0].number, model.status().message());
  Camera camera;
  camera.model = *model;
  const std::vector<absl::string_view> size = SplitFields(lines[1].text);
  if (size.size() != 2 || !absl::SimpleAtoi(size[0], &camera.width_px) ||
      !absl::SimpleAtoi(size[1], &camera.height_px)) {
    return LineError(path, lines[1].number, "expected `width height` of the raw images, in pixels");
  }
  const bool relative = numbers[2] < 1.0 && numbers[3] < 1.0;
  camera.fx_px = relative ? numbers[0] * camera.width_px : numbers[0];
  camera.fy_px = relative ? numbers[1] * camera.height_px : numbers[1];
  camera.cx_px = relative ? numbers[2] * camera.width_px - 0.5 : numbers[2];
  camera.cy_px = relative ? numbers[3] * camera.height_px - 0.5 : numbers[3];
  if (*model != CameraModel::kPinhole) camera.distortion.assign(numbers.begin() + 4, numbers.end());
  CAIRN_RETURN_IF_ERROR(Annotate(camera.Validate(), path));
  return camera;
}

// The file of each id; where no file is named as the ids are, the sorted files in the order of the lines.
class ImageFinder {
 public:
  explicit ImageFinder(const fs::path& folder) : folder_(folder), names_(ImageNamesIn(folder)) {
    for (const std::string& name : names_) name_of_stem_[fs::path(name).stem().string()] = name;
  }

  bool empty() const { return names_.empty(); }
  std::size_t size() const { return names_.size(); }
  bool Knows(const std::string& id) const { return name_of_stem_.count(id) > 0; }
  std::string ById(const std::string& id) const {
    const auto found = name_of_stem_.find(id);
    const std::string name =
        found != name_of_stem_.end() ? found->second : id + fs::path(names_[0]).extension().string();
    return (folder_ / name).string();
  }
  std::string ByPlace(std::size_t i) const { return (folder_ / names_[i]).string(); }

 private:
  fs::path folder_;
  std::vector<std::string> names_;
  std::map<std::string, std::string> name_of_stem_;
};

absl::StatusOr<double> ParseExposure(absl::string_view text) {
  double exposure_ms = 0.0;
  if (!absl::SimpleAtod(text, &exposure_ms) || !(exposure_ms >= 0.0 && exposure_ms < 1e6)) {
    return absl::InvalidArgumentError(absl::StrCat("\"", text, "\" is not an exposure time in milliseconds"));
  }
  return exposure_ms * 1e-3;
}

absl::StatusOr<std::vector<ListedImage>> ReadList(const std::string& path, const ImageFinder& finder, double rate_hz,
                                                  std::vector<std::string>* notes) {
  CAIRN_ASSIGN_OR_RETURN(const TextTable table, ReadTable(path));
  const std::vector<TextLine>& lines = table.lines;
  if (lines.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, " lists no images; expected lines of `id seconds exposure_ms`"));
  }
  std::vector<ListedImage> images;
  std::vector<std::string> ids;
  std::vector<TimeText> texts;
  for (const TextLine& line : lines) {
    const std::vector<absl::string_view> fields = SplitFields(line.text);
    if (fields.size() < 2) return LineError(path, line.number, "expected `id seconds exposure_ms`");
    CAIRN_RETURN_IF_ERROR(CheckNoMoreFields(path, line, fields.size(), 3, "id seconds exposure_ms", table.header));
    const absl::StatusOr<double> exposure_s = ParseExposure(fields.size() > 2 ? fields[2] : "0");
    if (!exposure_s.ok()) return LineError(path, line.number, exposure_s.status().message());
    ids.emplace_back(fields[0]);
    texts.push_back({line.number, fields[1]});
    images.push_back({0, "", *exposure_s});
  }
  TimeColumnRules rules;
  rules.rate_hz = rate_hz;
  rules.example = "# id time_ms exposure_ms";
  const std::vector<std::string> columns = ColumnNames(table.header);
  if (columns.size() > 1 && NamesTime(columns[1])) rules.named = UnitOfColumn(columns[1]);
  CAIRN_ASSIGN_OR_RETURN(const TimeColumn times, ReadTimeColumn(path, texts, rules));
  if (!times.note.empty()) notes->push_back(times.note);
  TimeOrder order;
  for (std::size_t i = 0; i < images.size(); ++i) {
    images[i].time_ns = times.times_ns[i];
    CAIRN_RETURN_IF_ERROR(order.Add(times.times_ns[i], path, lines[i].number));
  }
  const bool by_id = std::any_of(ids.begin(), ids.end(), [&](const std::string& id) { return finder.Knows(id); });
  if (!by_id && finder.size() != images.size()) {
    return absl::InvalidArgumentError(absl::StrCat(path, " has ", images.size(), " lines but images/ has ",
                                                   finder.size(), " files, none named by the ids"));
  }
  for (std::size_t i = 0; i < images.size(); ++i) images[i].path = by_id ? finder.ById(ids[i]) : finder.ByPlace(i);
  return images;
}

}  // namespace

bool LooksLikeTumMono(const fs::path& folder, const OpenOptions&) {
  return IsFile(folder / "times.txt") && (IsFile(folder / "camera.txt") || IsFile(folder / "pcalib.txt"));
}

absl::StatusOr<SequenceFiles> ReadTumMono(const fs::path& folder, const OpenOptions& options) {
  const ImageFinder finder(folder / "images");
  if (finder.empty()) {
    if (IsFile(folder / "images.zip")) {
      return absl::FailedPreconditionError(
          absl::StrCat("the images of ", folder.string(), " are packed; unzip them first: unzip ",
                       (folder / "images.zip").string(), " -d ", (folder / "images").string()));
    }
    return absl::NotFoundError(absl::StrCat("no images in ", (folder / "images").string()));
  }
  SequenceFiles out;
  if (options.camera_path.empty()) {
    CAIRN_ASSIGN_OR_RETURN(out.camera, ReadCameraText((folder / "camera.txt").string()));
  } else {
    CAIRN_ASSIGN_OR_RETURN(const CameraFile file, LoadCamera(options.camera_path));
    out.camera = file.camera;
    out.rate_hz = file.rate_hz;
  }
  CAIRN_ASSIGN_OR_RETURN(out.images, ReadList((folder / "times.txt").string(), finder, out.rate_hz, &out.notes));
  const fs::path response = folder / "pcalib.txt", vignette = folder / "vignette.png";
  if (IsFile(response) || IsFile(vignette)) {
    CAIRN_ASSIGN_OR_RETURN(out.photometric, LoadPhotometricCalibration(IsFile(response) ? response.string() : "",
                                                                       IsFile(vignette) ? vignette.string() : ""));
    CAIRN_RETURN_IF_ERROR(Annotate(out.photometric->ValidateFor(out.camera), vignette.string()));
  }
  return out;
}

}  // namespace cairn::io

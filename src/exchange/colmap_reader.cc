#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "base/files.h"
#include "exchange/colmap.h"
#include "exchange/colmap_format.h"

namespace cairn::exchange {
namespace {

using colmap::kModels;
using colmap::kNoPointBinary;
using colmap::kPixelCentre;
using colmap::ModelSpec;

constexpr std::uint64_t kMaxModelBytes = std::uint64_t{8} << 30;

// One focal length, then the centre, then the distortion; or two focal lengths.
Camera ToCamera(const ModelSpec& spec, std::uint64_t width, std::uint64_t height, const std::vector<double>& p) {
  Camera camera;
  camera.width_px = static_cast<int>(width);
  camera.height_px = static_cast<int>(height);
  const bool one_focal = spec.number == 0 || spec.number == 2 || spec.number == 3;
  const std::size_t centre = one_focal ? 1 : 2;
  camera.fx_px = p[0];
  camera.fy_px = one_focal ? p[0] : p[1];
  camera.cx_px = p[centre] - kPixelCentre;
  camera.cy_px = p[centre + 1] - kPixelCentre;
  const std::vector<double> rest(p.begin() + static_cast<std::ptrdiff_t>(centre) + 2, p.end());
  if (spec.number == 5) {
    camera.model = CameraModel::kKannalaBrandt;
    camera.distortion = rest;
  } else if (!rest.empty()) {
    camera.model = CameraModel::kRadialTangential;
    camera.distortion = {rest[0], rest.size() > 1 ? rest[1] : 0.0, rest.size() > 2 ? rest[2] : 0.0,
                         rest.size() > 3 ? rest[3] : 0.0};
  }
  return camera;
}

// Numbers and names one after another out of a binary file.
class BinaryReader {
 public:
  explicit BinaryReader(absl::string_view bytes) : bytes_(bytes) {}

  template <class T>
  T Take() {
    T value{};
    if (bytes_.size() < sizeof(T)) {
      good_ = false;
      bytes_ = {};
      return value;
    }
    std::memcpy(&value, bytes_.data(), sizeof(T));
    bytes_.remove_prefix(sizeof(T));
    return value;
  }
  std::string TakeName() {
    const std::size_t end = bytes_.find('\0');
    if (end == absl::string_view::npos) {
      good_ = false;
      return "";
    }
    std::string name(bytes_.substr(0, end));
    bytes_.remove_prefix(end + 1);
    return name;
  }
  // Of entries that take at least so many bytes each.
  std::uint64_t TakeCount(std::uint64_t bytes_each) {
    const auto count = Take<std::uint64_t>();
    if (count > bytes_.size() / bytes_each) good_ = false;
    return good_ ? count : 0;
  }
  bool good() const { return good_; }
  absl::Status Ended() const {
    if (!good_) return absl::DataLossError("is truncated, or no file of COLMAP's");
    return bytes_.empty() ? absl::OkStatus() : absl::DataLossError("goes on behind its end");
  }

 private:
  absl::string_view bytes_;
  bool good_ = true;
};

absl::Status TakeCamera(std::uint32_t id, const ModelSpec* spec, std::uint64_t width, std::uint64_t height,
                        const std::vector<double>& parameters, Reconstruction* model) {
  if (spec == nullptr) {
    return absl::InvalidArgumentError(absl::StrCat("camera ", id,
                                                   " is of a model that is not known here: undistort the "
                                                   "images with colmap image_undistorter first"));
  }
  if (width > 100'000 || height > 100'000)
    return absl::InvalidArgumentError(absl::StrCat("camera ", id, " is too large"));
  const Camera camera = ToCamera(*spec, width, height, parameters);
  CAIRN_RETURN_IF_ERROR(Annotate(camera.Validate(), absl::StrCat("camera ", id)));
  if (!model->cameras.emplace(id, camera).second) {
    return absl::InvalidArgumentError(absl::StrCat("there are two cameras ", id));
  }
  return absl::OkStatus();
}

absl::Status TakePose(const double (&v)[7], ModelImage* image) {
  for (const double value : v) {
    if (!std::isfinite(value))
      return absl::DataLossError(absl::StrCat("image ", image->id, ": its pose is not finite"));
  }
  const Quaterniond q(v[0], v[1], v[2], v[3]);
  if (!(std::abs(q.norm() - 1.0) < 1e-3)) {
    return absl::DataLossError(absl::StrCat("image ", image->id, ": its rotation is no unit quaternion"));
  }
  image->camera_from_world = SE3(q, Vector3d(v[4], v[5], v[6]));
  return absl::OkStatus();
}

absl::StatusOr<std::uint32_t> PointNumber(std::uint64_t id) {
  if (id == kNoPointBinary) return 0u;
  if (id == 0 || id > 0xFFFFFFFFu) return absl::InvalidArgumentError(absl::StrCat("a point has the id ", id));
  return static_cast<std::uint32_t>(id);
}

absl::Status ReadBinary(const std::string& folder, Reconstruction* model) {
  const auto read = [&](const char* name, const auto& parse) -> absl::Status {
    const std::string path = absl::StrCat(folder, "/", name);
    CAIRN_ASSIGN_OR_RETURN(const std::string bytes, ReadWholeFile(path, kMaxModelBytes));
    BinaryReader reader(bytes);
    absl::Status status = parse(reader);
    if (status.ok()) status = reader.Ended();
    return Annotate(status, path);
  };
  const auto cameras = [&](BinaryReader& in) -> absl::Status {
    const auto count = in.TakeCount(24);
    for (std::uint64_t i = 0; i < count && in.good(); ++i) {
      const auto id = in.Take<std::uint32_t>();
      const auto number = in.Take<std::int32_t>();
      const auto width = in.Take<std::uint64_t>(), height = in.Take<std::uint64_t>();
      const ModelSpec* spec = number >= 0 && number < static_cast<int>(std::size(kModels)) ? &kModels[number] : nullptr;
      std::vector<double> parameters;
      for (std::size_t k = 0; spec != nullptr && k < spec->parameters; ++k) parameters.push_back(in.Take<double>());
      if (in.good()) CAIRN_RETURN_IF_ERROR(TakeCamera(id, spec, width, height, parameters, model));
    }
    return absl::OkStatus();
  };
  CAIRN_RETURN_IF_ERROR(read("cameras.bin", cameras));
  const auto images = [&](BinaryReader& in) -> absl::Status {
    const auto count = in.TakeCount(73);
    for (std::uint64_t i = 0; i < count && in.good(); ++i) {
      ModelImage image;
      image.id = in.Take<std::uint32_t>();
      double pose[7];
      for (double& value : pose) value = in.Take<double>();
      image.camera = in.Take<std::uint32_t>();
      image.name = in.TakeName();
      const auto keypoints = in.TakeCount(24);
      for (std::uint64_t k = 0; k < keypoints; ++k) {
        const double x = in.Take<double>(), y = in.Take<double>();
        image.keypoints.emplace_back(x - kPixelCentre, y - kPixelCentre);
        CAIRN_ASSIGN_OR_RETURN(const std::uint32_t point, PointNumber(in.Take<std::uint64_t>()));
        image.points.push_back(point);
      }
      if (!in.good()) break;
      CAIRN_RETURN_IF_ERROR(TakePose(pose, &image));
      model->images.push_back(std::move(image));
    }
    return absl::OkStatus();
  };
  CAIRN_RETURN_IF_ERROR(read("images.bin", images));
  return read("points3D.bin", [&](BinaryReader& in) -> absl::Status {
    const auto count = in.TakeCount(51);
    for (std::uint64_t i = 0; i < count && in.good(); ++i) {
      ModelPoint point;
      CAIRN_ASSIGN_OR_RETURN(point.id, PointNumber(in.Take<std::uint64_t>()));
      for (int k = 0; k < 3; ++k) point.position[k] = in.Take<double>();
      for (std::uint8_t* value : {&point.red, &point.green, &point.blue}) *value = in.Take<std::uint8_t>();
      point.error_mean_px = in.Take<double>();
      const auto track = in.TakeCount(8);
      for (std::uint64_t k = 0; k < track; ++k) {
        const auto image = in.Take<std::uint32_t>();
        point.track.push_back({image, in.Take<std::uint32_t>()});
      }
      if (in.good()) model->points.push_back(std::move(point));
    }
    return absl::OkStatus();
  });
}

template <class T>
bool Parse(absl::string_view text, T* value) {
  if constexpr (std::is_same_v<T, double>)
    return absl::SimpleAtod(text, value);
  else
    return absl::SimpleAtoi(text, value);
}

// The words of each line that is no comment; `parse` gets them with the line's number.
template <class Use>
absl::Status ForEachLine(const std::string& folder, const char* name, bool keep_empty, const Use& use) {
  const std::string path = absl::StrCat(folder, "/", name);
  CAIRN_ASSIGN_OR_RETURN(const std::string text, ReadWholeFile(path, kMaxModelBytes));
  int number = 0;
  std::vector<absl::string_view> lines = absl::StrSplit(text, '\n');
  if (!lines.empty() && lines.back().empty()) lines.pop_back();
  for (const absl::string_view line : lines) {
    ++number;
    if (!line.empty() && line[0] == '#') continue;
    const std::vector<absl::string_view> words = absl::StrSplit(line, absl::ByAnyChar(" \r\t"), absl::SkipEmpty());
    if (words.empty() && !keep_empty) continue;
    CAIRN_RETURN_IF_ERROR(Annotate(use(words), absl::StrCat(path, ":", number)));
  }
  return absl::OkStatus();
}

const absl::Status kNoNumber = absl::DataLossError("has a word that is no number, or too few of them");

absl::Status ReadText(const std::string& folder, Reconstruction* model) {
  using Words = std::vector<absl::string_view>;
  const auto camera_line = [&](const Words& words) -> absl::Status {
    std::uint32_t id = 0;
    std::uint64_t width = 0, height = 0;
    if (words.size() < 4 || !Parse(words[0], &id) || !Parse(words[2], &width) || !Parse(words[3], &height))
      return kNoNumber;
    const auto* spec =
        std::find_if(std::begin(kModels), std::end(kModels), [&](const auto& m) { return words[1] == m.name; });
    if (spec == std::end(kModels)) return TakeCamera(id, nullptr, 0, 0, {}, model);
    if (words.size() != 4 + spec->parameters) return kNoNumber;
    std::vector<double> parameters(spec->parameters);
    for (std::size_t i = 0; i < parameters.size(); ++i) {
      if (!Parse(words[4 + i], &parameters[i])) return kNoNumber;
    }
    return TakeCamera(id, spec, width, height, parameters, model);
  };
  CAIRN_RETURN_IF_ERROR(ForEachLine(folder, "cameras.txt", false, camera_line));
  bool of_keypoints = false;  // the second line of an image, which may be empty
  const auto image_line = [&](const Words& words) -> absl::Status {
    if (!of_keypoints) {
      if (words.empty()) return absl::OkStatus();
      ModelImage image;
      double pose[7];
      if (words.size() < 10 || !Parse(words[0], &image.id) || !Parse(words[8], &image.camera)) return kNoNumber;
      for (std::size_t i = 0; i < 7; ++i) {
        if (!Parse(words[1 + i], &pose[i])) return kNoNumber;
      }
      image.name = absl::StrJoin(words.begin() + 9, words.end(), " ");
      CAIRN_RETURN_IF_ERROR(TakePose(pose, &image));
      model->images.push_back(std::move(image));
      of_keypoints = true;
      return absl::OkStatus();
    }
    of_keypoints = false;
    ModelImage& image = model->images.back();
    if (words.size() % 3 != 0) return kNoNumber;
    for (std::size_t i = 0; i + 2 < words.size(); i += 3) {
      double x, y;
      std::int64_t point;
      if (!Parse(words[i], &x) || !Parse(words[i + 1], &y) || !Parse(words[i + 2], &point)) return kNoNumber;
      image.keypoints.emplace_back(x - kPixelCentre, y - kPixelCentre);
      CAIRN_ASSIGN_OR_RETURN(const std::uint32_t number, PointNumber(static_cast<std::uint64_t>(point)));
      image.points.push_back(number);
    }
    return absl::OkStatus();
  };
  CAIRN_RETURN_IF_ERROR(ForEachLine(folder, "images.txt", true, image_line));
  return ForEachLine(folder, "points3D.txt", false, [&](const Words& words) -> absl::Status {
    ModelPoint point;
    std::uint64_t id = 0;
    double values[7];
    if (words.size() < 8 || words.size() % 2 != 0 || !Parse(words[0], &id)) return kNoNumber;
    for (std::size_t i = 0; i < 7; ++i) {
      if (!Parse(words[1 + i], &values[i])) return kNoNumber;
    }
    CAIRN_ASSIGN_OR_RETURN(point.id, PointNumber(id));
    point.position = Vector3d(values[0], values[1], values[2]);
    point.red = static_cast<std::uint8_t>(std::clamp(values[3], 0.0, 255.0));
    point.green = static_cast<std::uint8_t>(std::clamp(values[4], 0.0, 255.0));
    point.blue = static_cast<std::uint8_t>(std::clamp(values[5], 0.0, 255.0));
    point.error_mean_px = values[6];
    for (std::size_t i = 8; i < words.size(); i += 2) {
      ModelObservation observation;
      if (!Parse(words[i], &observation.image) || !Parse(words[i + 1], &observation.keypoint)) return kNoNumber;
      point.track.push_back(observation);
    }
    model->points.push_back(std::move(point));
    return absl::OkStatus();
  });
}

// Every id leads somewhere.
absl::Status CheckReferences(const Reconstruction& model) {
  std::unordered_map<std::uint32_t, const ModelImage*> images;
  std::unordered_set<std::uint32_t> points;
  for (const ModelPoint& point : model.points) {
    if (!points.insert(point.id).second)
      return absl::InvalidArgumentError(absl::StrCat("there are two points ", point.id));
  }
  for (const ModelImage& image : model.images) {
    if (!images.emplace(image.id, &image).second) {
      return absl::InvalidArgumentError(absl::StrCat("there are two images ", image.id));
    }
    if (!model.cameras.contains(image.camera)) {
      return absl::InvalidArgumentError(
          absl::StrCat("image ", image.id, " is of camera ", image.camera, ", which is missing"));
    }
    for (const std::uint32_t point : image.points) {
      if (point != 0 && !points.contains(point)) {
        return absl::InvalidArgumentError(
            absl::StrCat("image ", image.id, " sees point ", point, ", which is missing"));
      }
    }
  }
  for (const ModelPoint& point : model.points) {
    for (const ModelObservation& observation : point.track) {
      const auto image = images.find(observation.image);
      if (image == images.end() || observation.keypoint >= image->second->keypoints.size()) {
        return absl::InvalidArgumentError(absl::StrCat("point ", point.id, " is seen in image ", observation.image,
                                                       " at keypoint ", observation.keypoint, ", which is missing"));
      }
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<Reconstruction> ReadColmap(const std::string& folder) {
  Reconstruction model;
  const bool binary = std::filesystem::exists(absl::StrCat(folder, "/cameras.bin"));
  if (!binary && !std::filesystem::exists(absl::StrCat(folder, "/cameras.txt"))) {
    return absl::NotFoundError(absl::StrCat(folder,
                                            ": there is no cameras.bin or cameras.txt: name the folder of a "
                                            "sparse model of COLMAP's, such as sparse/0"));
  }
  CAIRN_RETURN_IF_ERROR(binary ? ReadBinary(folder, &model) : ReadText(folder, &model));
  CAIRN_RETURN_IF_ERROR(Annotate(CheckReferences(model), folder));
  const auto by_id = [](const auto& a, const auto& b) { return a.id < b.id; };
  std::sort(model.images.begin(), model.images.end(), by_id);
  std::sort(model.points.begin(), model.points.end(), by_id);
  return model;
}

}  // namespace cairn::exchange

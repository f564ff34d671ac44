#include "io/camera_file.h"

#include <array>
#include <charconv>
#include <set>

#include "absl/strings/str_join.h"
#include "io/atomic_file.h"
#include "io/sensor_file.h"
#include "io/yaml_file.h"

namespace cairn::io {
namespace {

constexpr std::array<absl::string_view, 5> kKeys = {"model", "resolution_px", "intrinsics_px", "distortion", "rate_hz"};

absl::Status CheckKeys(const std::string& path, const YAML::Node& root) {
  std::set<std::string> seen;
  for (const auto& entry : root) {
    const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : "";
    if (std::find(kKeys.begin(), kKeys.end(), key) == kKeys.end()) {
      return YamlError(path, entry.first,
                       absl::StrCat("unknown key `", key, "`; a camera file has ", absl::StrJoin(kKeys, ", ")));
    }
    if (!seen.insert(key).second) return YamlError(path, entry.first, absl::StrCat("the key `", key, "` is repeated"));
  }
  return absl::OkStatus();
}

absl::Status ReadRate(const std::string& path, const YAML::Node& root, CameraFile* out) {
  if (root["rate_hz"]) {
    CAIRN_ASSIGN_OR_RETURN(out->rate_hz, YamlNumber(path, root, "rate_hz"));
    if (!(out->rate_hz > 0.0 && out->rate_hz <= 1e6)) {
      return YamlError(path, root["rate_hz"], "`rate_hz` must be positive: images per second");
    }
  }
  return absl::OkStatus();
}

// The shortest text that gives back the same number.
std::string NumberText(double value) {
  std::array<char, 32> buffer;
  const auto result = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  return std::string(buffer.data(), result.ptr);
}

std::string ListText(const std::vector<double>& values) {
  return absl::StrCat(
      "[", absl::StrJoin(values, ", ", [](std::string* out, double v) { absl::StrAppend(out, NumberText(v)); }), "]");
}

}  // namespace

absl::StatusOr<CameraFile> LoadCamera(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const YAML::Node root, LoadYamlMap(path));
  CameraFile out;
  if (LooksLikeSensorFile(root)) {
    CAIRN_ASSIGN_OR_RETURN(out.camera, ReadSensorCamera(path, root));
    CAIRN_RETURN_IF_ERROR(ReadRate(path, root, &out));
    return out;
  }
  CAIRN_RETURN_IF_ERROR(CheckKeys(path, root));
  Camera& camera = out.camera;
  CAIRN_ASSIGN_OR_RETURN(const std::string model, YamlText(path, root, "model"));
  const absl::StatusOr<CameraModel> parsed_model = CameraModelFromName(model);
  if (!parsed_model.ok()) return YamlError(path, root["model"], parsed_model.status().message());
  camera.model = *parsed_model;
  CAIRN_RETURN_IF_ERROR(YamlSize(path, root, "resolution_px", &camera.width_px, &camera.height_px));
  CAIRN_ASSIGN_OR_RETURN(const std::vector<double> intrinsics, YamlNumbers(path, root, "intrinsics_px"));
  if (intrinsics.size() != 4) {
    return YamlError(path, root["intrinsics_px"],
                     absl::StrCat("`intrinsics_px` must be [fx, fy, cx, cy], not ", intrinsics.size(), " numbers"));
  }
  camera.fx_px = intrinsics[0];
  camera.fy_px = intrinsics[1];
  camera.cx_px = intrinsics[2];
  camera.cy_px = intrinsics[3];
  if (root["distortion"]) {
    CAIRN_ASSIGN_OR_RETURN(camera.distortion, YamlNumbers(path, root, "distortion"));
  }
  CAIRN_RETURN_IF_ERROR(ReadRate(path, root, &out));
  CAIRN_RETURN_IF_ERROR(Annotate(camera.Validate(), path));
  return out;
}

absl::Status SaveCamera(const std::string& path, const CameraFile& file, bool overwrite) {
  const Camera& c = file.camera;
  CAIRN_RETURN_IF_ERROR(Annotate(c.Validate(), absl::StrCat("writing ", path)));
  std::string text = absl::StrCat("# Cairn camera file: model pinhole | radial_tangential | kannala_brandt | fov\n",
                                  "model: ", CameraModelName(c.model), "\nresolution_px: [", c.width_px, ", ",
                                  c.height_px, "]\nintrinsics_px: ", ListText({c.fx_px, c.fy_px, c.cx_px, c.cy_px}),
                                  "   # fx fy cx cy\n", "distortion: ", ListText(c.distortion), "\n");
  if (file.rate_hz > 0.0) absl::StrAppend(&text, "rate_hz: ", NumberText(file.rate_hz), "\n");
  return WriteFileAtomically(path, text, overwrite);
}

}  // namespace cairn::io

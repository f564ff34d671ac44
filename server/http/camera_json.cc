#include "server/http/camera_json.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "absl/strings/str_join.h"

namespace cairn::server {
namespace {

// COLMAP's camera models, by its documentation: one or two focal lengths, the principal point, the distortion.
struct ColmapModel {
  absl::string_view name;
  CameraModel model;
  int focal_lengths;
  int distortion;  // parameters behind the principal point ...
  int padded;      // ... and as many as our model takes, zeros behind them
};
constexpr std::array<ColmapModel, 8> kModels = {{
    {"SIMPLE_PINHOLE", CameraModel::kPinhole, 1, 0, 0},
    {"PINHOLE", CameraModel::kPinhole, 2, 0, 0},
    {"SIMPLE_RADIAL", CameraModel::kRadialTangential, 1, 1, 4},
    {"RADIAL", CameraModel::kRadialTangential, 1, 2, 4},
    {"OPENCV", CameraModel::kRadialTangential, 2, 4, 4},
    {"FULL_OPENCV", CameraModel::kRadialTangential, 2, 8, 8},
    {"OPENCV_FISHEYE", CameraModel::kKannalaBrandt, 2, 4, 4},
    {"FOV", CameraModel::kFov, 2, 1, 1},
}};

absl::Status BadCamera(absl::string_view what) { return absl::InvalidArgumentError(absl::StrCat("camera: ", what)); }

absl::StatusOr<int> SizeOf(const nlohmann::json& json, const char* key) {
  if (!json.contains(key)) return 0;
  const nlohmann::json& value = json[key];
  if (!value.is_number_integer() || value.get<double>() < 1.0 || value.get<double>() > 1e6) {
    return BadCamera(absl::StrCat("`", key, "` must be a number of pixels"));
  }
  return value.get<int>();
}

absl::Status CheckKeys(const nlohmann::json& json) {
  for (const auto& entry : json.items()) {
    constexpr std::array<absl::string_view, 4> kKeys = {"model", "params", "width", "height"};
    if (std::find(kKeys.begin(), kKeys.end(), entry.key()) == kKeys.end()) {
      return BadCamera(absl::StrCat("there is no key `", entry.key(), "`; there are ", absl::StrJoin(kKeys, ", ")));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<Camera> CameraFromJson(const std::string& text) {
  const nlohmann::json json = nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object()) {
    const bool none = json.is_discarded();
    return BadCamera(absl::StrCat(none ? "this is no JSON (which has no NaN and no Infinity): " : "",
                                  R"(give {"model": "PINHOLE", "params": [fx, fy, cx, cy]})"));
  }
  CAIRN_RETURN_IF_ERROR(CheckKeys(json));
  if (!json.contains("model") || !json["model"].is_string()) return BadCamera("`model` is missing");
  const std::string name = json["model"].get<std::string>();
  const auto* model = std::find_if(kModels.begin(), kModels.end(), [&](const auto& m) { return m.name == name; });
  if (model == kModels.end()) {
    return BadCamera(absl::StrCat(
        "there is no model ", name, "; there are ",
        absl::StrJoin(kModels, ", ", [](std::string* out, const ColmapModel& m) { absl::StrAppend(out, m.name); })));
  }
  const int expected = model->focal_lengths + 2 + model->distortion;
  std::vector<double> params;
  if (json.contains("params") && json["params"].is_array()) {
    for (const nlohmann::json& value : json["params"]) params.push_back(value.is_number() ? value.get<double>() : NAN);
  }
  if (static_cast<int>(params.size()) != expected ||
      !std::all_of(params.begin(), params.end(), [](double p) { return std::isfinite(p); })) {
    return BadCamera(absl::StrCat("`params` of ", name, " are ", expected, " numbers"));
  }
  Camera camera;
  camera.model = model->model;
  CAIRN_ASSIGN_OR_RETURN(camera.width_px, SizeOf(json, "width"));
  CAIRN_ASSIGN_OR_RETURN(camera.height_px, SizeOf(json, "height"));
  auto next = params.begin();
  camera.fx_px = *next++;
  camera.fy_px = model->focal_lengths == 2 ? *next++ : camera.fx_px;
  camera.cx_px = *next++ - 0.5;
  camera.cy_px = *next++ - 0.5;
  camera.distortion.assign(next, params.end());
  camera.distortion.resize(static_cast<std::size_t>(model->padded), 0.0);
  return camera;
}

}  // namespace cairn::server

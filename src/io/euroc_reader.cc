// EuRoC / ASL folders (Burri et al., "The EuRoC micro aerial vehicle datasets", IJRR 2016), and TUM VI, which has the
// same layout: mav0/camN/{sensor.yaml, data.csv, data/}.
#include "absl/strings/str_join.h"
#include "io/body_camera.h"
#include "io/sensor_file.h"
#include "io/sequence_readers.h"
#include "io/text_lines.h"
#include "io/time_column.h"
#include "io/yaml_file.h"

namespace cairn::io {
namespace {

namespace fs = std::filesystem;

bool IsCameraFolder(const fs::path& folder) {
  return IsFile(folder / "data.csv") && (IsFile(folder / "sensor.yaml") || IsFolder(folder / "data"));
}

// The folder that holds cam0, cam1, ...; or the camera folder itself.
std::optional<fs::path> CameraFolder(const fs::path& folder, int index) {
  const std::string name = absl::StrCat("cam", index);
  for (const fs::path& candidate : {folder / "mav0" / name, folder / name, folder}) {
    if (IsCameraFolder(candidate)) return candidate;
  }
  return std::nullopt;
}

absl::Status ReadSensor(const std::string& path, bool with_camera, SequenceFiles& out) {
  CAIRN_ASSIGN_OR_RETURN(const YAML::Node root, LoadYamlMap(path));
  CAIRN_ASSIGN_OR_RETURN(out.body_from_camera, FindBodyFromCamera(path));
  if (root["rate_hz"]) {
    CAIRN_ASSIGN_OR_RETURN(out.rate_hz, YamlNumber(path, root, "rate_hz"));
  }
  if (!with_camera) return absl::OkStatus();
  CAIRN_ASSIGN_OR_RETURN(out.camera, ReadSensorCamera(path, root));
  return absl::OkStatus();
}

absl::Status ReadList(const fs::path& list, SequenceFiles* out) {
  CAIRN_ASSIGN_OR_RETURN(const TextTable table, ReadTable(list.string()));
  if (table.lines.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(list.string(), " lists no images; expected lines of `ns,filename`"));
  }
  std::vector<TimeText> texts;
  std::vector<std::string> names;
  for (const TextLine& line : table.lines) {
    const std::vector<absl::string_view> fields = SplitFields(line.text);
    texts.push_back({line.number, fields[0]});
    names.push_back(fields.size() > 1 ? std::string(fields[1]) : absl::StrCat(fields[0], ".png"));
  }
  TimeColumnRules rules;
  rules.usual = TimeUnit::kNanoseconds;
  rules.rate_hz = out->rate_hz;
  rules.example = "#timestamp [ns],filename";
  const std::vector<std::string> columns = ColumnNames(table.header);
  if (!columns.empty() && NamesTime(columns[0])) rules.named = UnitOfColumn(columns[0]);
  CAIRN_ASSIGN_OR_RETURN(const TimeColumn times, ReadTimeColumn(list.string(), texts, rules));
  if (!times.note.empty()) out->notes.push_back(times.note);
  TimeOrder order;
  for (std::size_t i = 0; i < names.size(); ++i) {
    CAIRN_RETURN_IF_ERROR(order.Add(times.times_ns[i], list.string(), texts[i].line));
    // Some name the folder too.
    const fs::path folder = list.parent_path();
    const bool from_list = !IsFile(folder / "data" / names[i]) && IsFile(folder / names[i]);
    out->images.push_back({times.times_ns[i], ((from_list ? folder : folder / "data") / names[i]).string(), 0.0});
  }
  return absl::OkStatus();
}

int IndexIn(const fs::path& folder, const OpenOptions& options) {
  return ChooseCamera(options, [&](int index) { return CameraFolder(folder, index).has_value(); });
}

}  // namespace

bool LooksLikeEuroc(const fs::path& folder, const OpenOptions& options) {
  return IsFolder(folder / "mav0") || CameraFolder(folder, IndexIn(folder, options)).has_value();
}

absl::StatusOr<SequenceFiles> ReadEuroc(const fs::path& folder, const OpenOptions& options) {
  const int index = IndexIn(folder, options);
  const std::optional<fs::path> camera_folder = CameraFolder(folder, index);
  if (!camera_folder) {
    std::vector<std::string> there;
    for (int i = 0; i < kMaxCameras; ++i) {
      if (CameraFolder(folder, i)) there.push_back(absl::StrCat("cam", i));
    }
    return absl::NotFoundError(absl::StrCat(
        "no camera ", index, " in ", folder.string(), ": looked for mav0/cam", index, "/data.csv, cam", index,
        "/data.csv and data.csv; ",
        there.empty() ? "no other camera is there" : absl::StrCat("there is ", absl::StrJoin(there, ", "))));
  }
  SequenceFiles out;
  if (index != 0) out.notes.push_back(absl::StrCat("camera ", index, ": ", camera_folder->string()));
  const fs::path sensor = *camera_folder / "sensor.yaml";
  const bool given = !options.camera_path.empty();
  if (IsFile(sensor) || !given) CAIRN_RETURN_IF_ERROR(ReadSensor(sensor.string(), !given, out));
  if (given) {
    CAIRN_ASSIGN_OR_RETURN(const CameraFile file, LoadCamera(options.camera_path));
    out.camera = file.camera;
    if (file.rate_hz > 0.0) out.rate_hz = file.rate_hz;
  }
  CAIRN_RETURN_IF_ERROR(ReadList(*camera_folder / "data.csv", &out));
  return out;
}

}  // namespace cairn::io

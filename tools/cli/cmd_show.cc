// cairn show: one keyframe, point, session, component or camera of a map, with all that is known of it.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <set>

#include "absl/strings/str_format.h"
#include "cli/cli.h"
#include "cli/loaded_map.h"
#include "cli/map_to_read.h"
#include "cli/session_report.h"
#include "inspect/listing.h"
#include "inspect/measures.h"
#include "plot/inspect_figures.h"
#include "store/map_store.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

using nlohmann::ordered_json;

constexpr std::size_t kShownNeighbours = 8;
constexpr std::size_t kShownSights = 12;
constexpr double kPatchRadiusPx = 3.0;  // drawn for a feature of octave 0

struct ShowOptions {
  std::string map;
  ServerChoice server;
  std::string kind;
  std::uint32_t id = 0;
  std::string picture;
  bool overwrite = false;
  bool json = false;
};

const std::map<std::string, inspect::Kind> kShownKinds = {{"keyframe", inspect::Kind::kKeyframes},
                                                          {"point", inspect::Kind::kPoints},
                                                          {"session", inspect::Kind::kSessions},
                                                          {"component", inspect::Kind::kComponents},
                                                          {"camera", inspect::Kind::kCameras}};

ordered_json PoseAsJson(const SE3& pose) {
  const Vector3d& t = pose.translation();
  const Quaterniond& q = pose.rotation();
  return {{"translation", {t.x(), t.y(), t.z()}}, {"quaternion_xyzw", {q.x(), q.y(), q.z(), q.w()}}};
}

ordered_json Rounded(double value, double step = 1e-6) { return std::round(value / step) * step; }

// Neighbours in the order of the points that they share.
ordered_json NeighboursAsJson(const map::Snapshot& map, const map::Keyframe& keyframe) {
  ordered_json neighbours = ordered_json::array();
  const double scale = inspect::PlacedScale(map, keyframe.component);
  for (const map::CovisibilityEdge& edge : keyframe.covisible) {
    const map::Keyframe& other = map.keyframe(edge.keyframe);
    neighbours.push_back(
        {{"keyframe", edge.keyframe.value()},
         {"session", other.session.value()},
         {"shared_points", edge.shared_points},
         {"distance", Rounded(scale * (other.CenterInMap() - keyframe.CenterInMap()).norm())},
         {"angle_deg", Rounded(inspect::AxisAngleDeg(keyframe.camera_from_map, other.camera_from_map), 1e-3)}});
  }
  return neighbours;
}

ordered_json DescribeKeyframe(const map::Snapshot& map, const map::Keyframe& keyframe) {
  ordered_json json;
  AddFrameAndUnit(map.WorldFrom(keyframe.component).has_value(), &json);
  const std::set<std::uint32_t> words(keyframe.features->words.begin(), keyframe.features->words.end());
  std::vector<int> octaves(static_cast<std::size_t>(std::max(1, map.info().orb.num_levels)));
  for (const image::Keypoint& keypoint : keyframe.keypoints()) ++octaves[keypoint.octave];
  ordered_json children = ordered_json::array();
  for (const KeyframeId child : keyframe.children) children.push_back(child.value());
  json.update({{"pose", PoseAsJson(inspect::PlacedPose(map, keyframe))},
               {"frame_index", keyframe.frame_index},
               {"direct_segment", keyframe.direct_segment},
               {"parent", keyframe.parent ? ordered_json(keyframe.parent.value()) : ordered_json()},
               {"children", children},
               {"distinct_words", words.size()},
               {"features_per_octave", octaves},
               {"neighbours", NeighboursAsJson(map, keyframe)}});
  return json;
}

ordered_json DescribePoint(const map::Snapshot& map, const map::MapPoint& point) {
  const ComponentId component = inspect::ComponentOf(map, point);
  ordered_json json, sights = ordered_json::array();
  AddFrameAndUnit(map.WorldFrom(component).has_value(), &json);
  const double scale = inspect::PlacedScale(map, component);
  for (const map::Observation& observation : point.observations) {
    const map::Keyframe& keyframe = map.keyframe(observation.keyframe);
    const image::Keypoint& keypoint = keyframe.keypoints()[observation.feature];
    const auto measured = inspect::Measure(map, keyframe, observation.feature);
    const Vector3d ray = (point.position - keyframe.CenterInMap()).normalized();
    sights.push_back(
        {{"keyframe", keyframe.id.value()},
         {"session", keyframe.session.value()},
         {"x_px", keypoint.x_px},
         {"y_px", keypoint.y_px},
         {"octave", keypoint.octave},
         {"error_px", measured ? Rounded(measured->error_px.norm(), 1e-4) : ordered_json()},
         {"distance", Rounded(scale * (point.position - keyframe.CenterInMap()).norm())},
         {"from_mean_deg",
          Rounded(std::acos(std::clamp(ray.dot(point.mean_view_direction.cast<double>()), -1.0, 1.0)) * 180.0 / M_PI,
                  1e-3)}});
  }
  json.update({{"times_visible", point.times_visible}, {"times_found", point.times_found}, {"seen_from", sights}});
  return json;
}

ordered_json DescribeSession(const map::Session& session) {
  return {{"software_version", session.software_version},
          {"settings", SettingsAsJson(session)},
          {"loops_closed", LoopsAsJson(session)},
          {"trajectory", TrajectoryAsJson(session)}};
}

ordered_json DescribeComponent(const map::Component& component) {
  ordered_json json = {{"world_from_component", nullptr}, {"join", nullptr}};
  const auto similarity = [](const Sim3& s) -> ordered_json {
    ordered_json as_json = PoseAsJson(SE3(s.rotation(), s.translation()));
    as_json["scale"] = s.scale();
    return as_json;
  };
  if (component.world_from_component) json["world_from_component"] = similarity(*component.world_from_component);
  if (!component.joined) return json;
  const map::ComponentJoin& join = *component.joined;
  json["join"] = {{"into", join.into.value()},
                  {"revision", join.revision},
                  {"keyframe", join.keyframe.value()},
                  {"into_keyframe", join.into_keyframe.value()},
                  {"matches", join.matches},
                  {"keyframes_agreeing", join.keyframes_agreeing},
                  {"keyframes_checked", join.keyframes_checked},
                  {"into_from_component", similarity(join.into_from_component)}};
  return json;
}

ordered_json DescribeCamera(const map::MapCamera& camera) {
  const Pinhole& p = camera.pinhole;
  return {{"calibration", camera.model.Describe()},
          {"pinhole",
           {{"width_px", p.width_px},
            {"height_px", p.height_px},
            {"fx_px", p.fx_px},
            {"fy_px", p.fy_px},
            {"cx_px", p.cx_px},
            {"cy_px", p.cy_px}}},
          {"lens", LensAsJson(camera)}};
}

ordered_json Details(const map::Snapshot& map, inspect::Kind kind, std::uint32_t id) {
  switch (kind) {
    case inspect::Kind::kKeyframes:
      return DescribeKeyframe(map, map.keyframe(KeyframeId(id)));
    case inspect::Kind::kPoints:
      return DescribePoint(map, map.point(PointId(id)));
    case inspect::Kind::kSessions:
      return DescribeSession(map.sessions().at(SessionId(id)));
    case inspect::Kind::kComponents:
      return DescribeComponent(map.component(ComponentId(id)));
    case inspect::Kind::kCameras:
      return DescribeCamera(map.cameras().at(CameraId(id)));
  }
  return {};
}

plot::ViewFigure FigureOf(const map::Snapshot& map, const map::Keyframe& keyframe) {
  plot::ViewFigure figure;
  const auto observations = inspect::Measure(map, keyframe);
  const auto error = inspect::ErrorRmsPx(observations);
  const Pinhole& pinhole = map.pinhole(keyframe.camera);
  figure.title = absl::StrFormat("%s, keyframe %u", map.info().name, keyframe.id.value());
  figure.subtitle = absl::StrFormat("session %u, %.2f s: %d features, %d with a point%s", keyframe.session.value(),
                                    ToSeconds(keyframe.time_ns), keyframe.points.size(), observations.size(),
                                    error ? absl::StrFormat(", reprojection error %.2f px RMS", *error) : "");
  figure.width_px = pinhole.width_px;
  figure.height_px = pinhole.height_px;
  for (const image::Keypoint& keypoint : keyframe.keypoints()) {
    plot::ViewMark& mark = figure.marks.emplace_back();
    mark.pixel = {keypoint.x_px, keypoint.y_px};
    mark.radius_px = kPatchRadiusPx * map.info().orb.Scale(keypoint.octave);
  }
  for (const inspect::MeasuredObservation& observation : observations) {
    figure.marks[observation.feature].has_point = true;
    figure.marks[observation.feature].error_px = observation.error_px;
  }
  return figure;
}

// Lists of objects as tables, everything else as "name: value".
void PrintRows(const std::string& title, const ordered_json& rows, std::size_t most) {
  std::printf("%s (%zu):\n", title.c_str(), rows.size());
  std::vector<text::TextColumn> columns;
  for (const auto& [key, value] : rows[0].items()) columns.push_back({key, value.is_string()});
  std::vector<std::vector<std::string>> cells;
  for (std::size_t i = 0; i < std::min(most, rows.size()); ++i) {
    std::vector<std::string>& row = cells.emplace_back();
    for (const auto& [key, value] : rows[i].items()) {
      row.push_back(value.is_null()           ? "-"
                    : value.is_number_float() ? absl::StrFormat("%.2f", value.get<double>())
                    : value.is_string()       ? value.get<std::string>()
                                              : value.dump());
    }
  }
  std::fputs(text::TextTable(columns, cells, "  ").c_str(), stdout);
  if (rows.size() > most) std::printf("  ... %zu more (--json)\n", rows.size() - most);
}

void PrintValue(const std::string& key, const ordered_json& value) {
  if (value.is_object() && !value.empty()) {
    for (const auto& [inner, of] : value.items()) PrintValue(absl::StrCat(key, ".", inner), of);
    return;
  }
  std::string shown = value.is_null()           ? "-"
                      : value.is_string()       ? text::Shown(value.get<std::string>())
                      : value.is_number_float() ? absl::StrFormat("%.6g", value.get<double>())
                                                : "";
  if (value.is_array()) {
    for (const ordered_json& item : value) {
      absl::StrAppend(&shown, shown.empty() ? "" : " ",
                      item.is_number_float() ? absl::StrFormat("%.6g", item.get<double>()) : item.dump());
    }
  } else if (shown.empty()) {
    shown = value.is_string() ? "-" : value.dump();
  }
  std::fputs(text::Wrapped(shown, absl::StrFormat("  %-18s ", absl::StrCat(key, ":")), "                     ").c_str(),
             stdout);
}

// What is told of it, and drawn.
struct ShownEntity {
  ordered_json json;
  plot::ViewFigure figure;
};

absl::Status LookAt(const ShowOptions& options, const map::Snapshot& map, ShownEntity* shown) {
  const inspect::Kind kind = kShownKinds.at(options.kind);
  const std::optional<inspect::Listing> listing = inspect::ListOne(map, kind, options.id);
  if (!listing) return absl::NotFoundError(absl::StrCat(options.map, ": there is no ", options.kind, " ", options.id));
  shown->json = {{"map", options.map}, {"revision", map.revision()}};
  for (std::size_t i = 0; i < listing->columns.size(); ++i) {
    const inspect::Cell& cell = listing->rows[0][i];
    ordered_json& value = shown->json[listing->columns[i].name];
    if (cell.kind == inspect::Cell::Kind::kText) value = cell.text;
    if (cell.kind == inspect::Cell::Kind::kFlag) value = cell.whole != 0;
    if (cell.kind == inspect::Cell::Kind::kWhole) value = cell.whole;
    if (cell.kind == inspect::Cell::Kind::kReal) value = cell.real;
  }
  shown->json.update(Details(map, kind, options.id));
  if (!options.picture.empty()) shown->figure = FigureOf(map, map.keyframe(KeyframeId(options.id)));
  return absl::OkStatus();
}

absl::Status Show(const ShowOptions& options) {
  CAIRN_RETURN_IF_ERROR(CheckWritable(options.picture, options.overwrite));
  CAIRN_RETURN_IF_ERROR(CheckDistinct({options.picture}, {InputFile(options.server, options.map)}));
  CAIRN_RETURN_IF_ERROR(CheckPicture(options.picture));
  TellLogDamage("show", options.server, options.map);
  CAIRN_ASSIGN_OR_RETURN(const MapToRead source, MapToRead::Open(options.server, options.map));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> file,
                         store::OpenMapStore(source.path(), store::OpenMode::kRead));
  ShownEntity shown;
  const bool few = options.kind == "keyframe" || options.kind == "point";
  CAIRN_RETURN_IF_ERROR(LookInto(*file, few, [&](const map::Snapshot& map) { return LookAt(options, map, &shown); }));
  if (!options.picture.empty()) {
    plot::FigureOptions to;
    to.overwrite = options.overwrite;
    CAIRN_RETURN_IF_ERROR(plot::WriteViewFigure(shown.figure, options.picture, to));
  }
  if (options.json) {
    PrintJson(shown.json);
    return absl::OkStatus();
  }
  std::printf("%s %u of %s\n", options.kind.c_str(), options.id, text::Shown(options.map).c_str());
  for (const auto& [key, value] : shown.json.items()) {
    if (key == "map" || key == "id") continue;
    if (value.is_array() && !value.empty() && value[0].is_object()) {
      PrintRows(key, value, key == "neighbours" ? kShownNeighbours : kShownSights);
    } else {
      PrintValue(key, value);
    }
  }
  if (!options.picture.empty()) std::printf("picture: %s\n", text::Shown(options.picture).c_str());
  return absl::OkStatus();
}

}  // namespace

void AddShowCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("show", "All that is known of a keyframe, point, session, component or camera");
  auto options = std::make_shared<ShowOptions>();
  verb->add_option("MAP", options->map, "Map file (.cairn), with --server the name of a map there")->required();
  verb->add_option("KIND", options->kind, "keyframe, point, session, component or camera")
      ->required()
      ->check(CLI::IsMember({"keyframe", "point", "session", "component", "camera"}));
  verb->add_option("ID", options->id, "Its number, as of cairn ls")->required();
  verb->add_option("--picture", options->picture, "Draw what a keyframe sees to this .png or .svg file");
  verb->add_flag("--overwrite", options->overwrite, "Replace the picture if it exists");
  verb->add_flag("--json", options->json, "Answer in JSON, with everything of long lists");
  verb->footer(
      "pose: world_from_camera in metres where the component is aligned, else map_from_camera.\n"
      "Exit codes: 0 ok, 1 failure (there is none of that number), 2 usage, 3 map damaged, 5 version.\n"
      "Examples:\n"
      "  cairn show office.cairn keyframe 12 --picture keyframe_12.png\n"
      "  cairn show office.cairn point 345\n"
      "  cairn --server localhost:7878 show office session 2");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      if (!options->picture.empty() && options->kind != "keyframe") {
        return FailUsage("show", absl::StrCat("--picture draws what a keyframe sees: not of a ", options->kind),
                         options->json);
      }
      const absl::Status status = Show(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("show", status, options->json);
    };
  });
}

}  // namespace cairn::cli

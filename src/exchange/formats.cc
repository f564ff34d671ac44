#include "exchange/formats.h"

#include <algorithm>
#include <set>
#include <unordered_map>

#include "absl/strings/str_format.h"
#include "nlohmann/json.hpp"

namespace cairn::exchange {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kHalfPixel = 0.5;  // nerfstudio's

Json AsJson(const Vector3d& v) { return {v.x(), v.y(), v.z()}; }
Json AsJson(const Quaterniond& q) { return {q.x(), q.y(), q.z(), q.w()}; }

std::string Dump(const Json& json) {
  return absl::StrCat(json.dump(1, ' ', false, nlohmann::ordered_json::error_handler_t::replace), "\n");
}

// Rows of the 4x4 matrix.
Json MatrixAsJson(const Eigen::Matrix4d& matrix) {
  Json rows = Json::array();
  for (int r = 0; r < 4; ++r) rows.push_back({matrix(r, 0), matrix(r, 1), matrix(r, 2), matrix(r, 3)});
  return rows;
}

}  // namespace

std::vector<io::StampedPose> Trajectory(const Reconstruction& model) {
  std::vector<io::StampedPose> poses;
  for (const ModelImage& image : model.images) poses.push_back({image.time_ns, image.camera_from_world.Inverse()});
  std::stable_sort(poses.begin(), poses.end(), [](const auto& a, const auto& b) { return a.time_ns < b.time_ns; });
  return poses;
}

std::string KittiText(const std::vector<io::StampedPose>& poses) {
  std::string text;
  for (const io::StampedPose& pose : poses) {
    const Matrix34d m = pose.world_from_camera.Matrix();
    for (int i = 0; i < 12; ++i) absl::StrAppendFormat(&text, "%s%.12g", i > 0 ? " " : "", m(i / 4, i % 4));
    text += "\n";
  }
  return text;
}

std::string KittiTimesText(const std::vector<io::StampedPose>& poses) {
  std::string text;
  for (const io::StampedPose& pose : poses) absl::StrAppendFormat(&text, "%.9f\n", ToSeconds(pose.time_ns));
  return text;
}

std::string EurocText(const std::vector<io::StampedPose>& poses) {
  std::string text =
      "#timestamp [ns], p_x [m], p_y [m], p_z [m], q_w [], q_x [], q_y [], q_z [] "
      "(world_from_camera: of the camera, not of a body)\n";
  for (const io::StampedPose& pose : poses) {
    const Vector3d& t = pose.world_from_camera.translation();
    const Quaterniond& q = pose.world_from_camera.rotation();
    absl::StrAppend(&text, pose.time_ns);
    for (const double number : {t.x(), t.y(), t.z(), q.w(), q.x(), q.y(), q.z()}) {
      absl::StrAppend(&text, ",", io::FormatPoseNumber(number));
    }
    text += "\n";
  }
  return text;
}

std::string TransformsJson(const Reconstruction& model) {
  Json json = {{"camera_model", "OPENCV"}, {"orientation_override", "none"}, {"frames", Json::array()}};
  const auto intrinsics = [](const Camera& camera, Json* to) {
    (*to)["fl_x"] = camera.fx_px;
    (*to)["fl_y"] = camera.fy_px;
    (*to)["cx"] = camera.cx_px + kHalfPixel;
    (*to)["cy"] = camera.cy_px + kHalfPixel;
    (*to)["w"] = camera.width_px;
    (*to)["h"] = camera.height_px;
    for (const char* name : {"k1", "k2", "p1", "p2"}) (*to)[name] = 0.0;
  };
  if (model.cameras.size() == 1) intrinsics(model.cameras.begin()->second, &json);
  for (const ModelImage& image : model.images) {
    Eigen::Matrix4d world_from_camera = Eigen::Matrix4d::Identity();
    world_from_camera.topRows<3>() = image.camera_from_world.Inverse().Matrix();
    world_from_camera.col(1) *= -1.0;
    world_from_camera.col(2) *= -1.0;
    Json frame = {{"file_path", absl::StrCat("images/", image.name)},
                  {"transform_matrix", MatrixAsJson(world_from_camera)}};
    if (model.cameras.size() > 1) intrinsics(model.cameras.at(image.camera), &frame);
    json["frames"].push_back(std::move(frame));
  }
  return Dump(json);
}

std::string G2oText(const Reconstruction& model, const map::Snapshot& map) {
  std::string text;
  std::unordered_map<std::uint32_t, SE3> world_from;
  const auto append = [&](const SE3& pose) {
    const Vector3d& t = pose.translation();
    const Quaterniond& q = pose.rotation();
    absl::StrAppendFormat(&text, " %.12g %.12g %.12g %.12g %.12g %.12g %.12g", t.x(), t.y(), t.z(), q.x(), q.y(), q.z(),
                          q.w());
  };
  for (const ModelImage& image : model.images) {
    world_from.emplace(image.id, image.camera_from_world.Inverse());
    absl::StrAppend(&text, "VERTEX_SE3:QUAT ", image.id);
    append(world_from.at(image.id));
    text += "\n";
  }
  for (const ModelImage& image : model.images) {
    const map::Keyframe& keyframe = map.keyframe(KeyframeId(image.id));
    for (const map::CovisibilityEdge& edge : keyframe.covisible) {
      const std::uint32_t other = edge.keyframe.value();
      const bool in_tree = keyframe.parent == edge.keyframe || map.keyframe(edge.keyframe).parent == keyframe.id;
      if (other < image.id || !world_from.contains(other)) continue;
      if (edge.shared_points < map::kMinEssentialPoints && !in_tree) continue;
      absl::StrAppend(&text, "EDGE_SE3:QUAT ", image.id, " ", other);
      append(image.camera_from_world * world_from.at(other));
      for (int row = 0; row < 6; ++row) {
        for (int col = row; col < 6; ++col) absl::StrAppend(&text, " ", row == col ? edge.shared_points : 0);
      }
      text += "\n";
    }
  }
  return text;
}

namespace {

Json SessionsAsJson(const std::set<SessionId>& ids, const map::Snapshot& map) {
  Json sessions = Json::array();
  for (const SessionId id : ids) {
    const map::Session& session = map.sessions().at(id);
    sessions.push_back({{"id", id.value()},
                        {"source", session.source},
                        {"camera", session.camera.value()},
                        {"first_s", ToSeconds(session.first_ns)},
                        {"last_s", ToSeconds(session.last_ns)},
                        {"complete", session.complete}});
  }
  return sessions;
}

// `in_world`: the model is; else it is in the frame of its one component, whatever that is aligned to.
Json ComponentsAsJson(const std::set<ComponentId>& ids, bool in_world, const map::Snapshot& map) {
  Json components = Json::array();
  for (const ComponentId id : ids) {
    const std::optional<Sim3>& world_from = map.WorldFrom(id);
    Json component = {{"id", id.value()}, {"world_from_component", nullptr}};
    if (in_world && world_from) {
      component["world_from_component"] = {{"scale", world_from->scale()},
                                           {"translation", AsJson(world_from->translation())},
                                           {"quaternion_xyzw", AsJson(world_from->rotation())}};
    }
    components.push_back(std::move(component));
  }
  return components;
}

}  // namespace

std::string ModelJson(const Reconstruction& model, const map::Snapshot& map) {
  std::set<SessionId> sessions;
  std::set<ComponentId> components;
  for (const ModelImage& image : model.images) {
    const map::Keyframe& keyframe = map.keyframe(KeyframeId(image.id));
    sessions.insert(keyframe.session);
    components.insert(keyframe.component);
  }
  Json json = {{"map_id", map.info().id},
               {"name", map.info().name},
               {"revision", map.revision()},
               {"frame", model.metric ? "world" : "map"},
               {"unit", model.metric ? "m" : "map units"},
               {"sessions", SessionsAsJson(sessions, map)},
               {"components", ComponentsAsJson(components, model.metric, map)},
               {"cameras", Json::array()},
               {"keyframes", Json::array()},
               {"points", Json::array()}};
  for (const auto& [id, camera] : model.cameras) {
    json["cameras"].push_back({{"id", id},
                               {"width_px", camera.width_px},
                               {"height_px", camera.height_px},
                               {"fx_px", camera.fx_px},
                               {"fy_px", camera.fy_px},
                               {"cx_px", camera.cx_px},
                               {"cy_px", camera.cy_px}});
  }
  for (const ModelImage& image : model.images) {
    const SE3 world_from_camera = image.camera_from_world.Inverse();
    Json observations = Json::array();
    for (std::size_t i = 0; i < image.keypoints.size(); ++i) {
      if (image.points[i] != 0) {
        observations.push_back({image.points[i], image.keypoints[i].x(), image.keypoints[i].y()});
      }
    }
    const map::Keyframe& keyframe = map.keyframe(KeyframeId(image.id));
    json["keyframes"].push_back({{"id", image.id},
                                 {"session", keyframe.session.value()},
                                 {"component", keyframe.component.value()},
                                 {"camera", image.camera},
                                 {"name", image.name},
                                 {"time_s", ToSeconds(image.time_ns)},
                                 {"position", AsJson(world_from_camera.translation())},
                                 {"quaternion_xyzw", AsJson(world_from_camera.rotation())},
                                 {"observations_point_x_y", std::move(observations)}});
  }
  for (const ModelPoint& point : model.points) {
    json["points"].push_back({{"id", point.id},
                              {"position", AsJson(point.position)},
                              {"error_px", point.error_rms_px},
                              {"error_mean_px", point.error_mean_px},
                              {"gray", point.red},
                              {"observations", point.track.size()}});
  }
  return Dump(json);
}

}  // namespace cairn::exchange

#include "cli/pictures.h"

#include <algorithm>
#include <map>

#include "cli/component_report.h"
#include "cli/map_scene.h"
#include "inspect/measures.h"
#include "plot/figures.h"

namespace cairn::cli {

absl::Status DrawMap(const map::Snapshot& map, const std::string& path, const std::vector<SE3>& queries) {
  // Where components lie to each other is known only of those that are aligned.
  const std::vector<ComponentId> shown = inspect::TogetherInOneFrame(map);
  const auto is_shown = [&](ComponentId id) { return std::ranges::find(shown, id) != shown.end(); };
  const auto world_from = [&](ComponentId id) { return map.WorldFrom(id).value_or(Sim3()); };
  plot::MapFigure figure;
  figure.title = map.info().name;
  figure.metric = !shown.empty() && map.WorldFrom(shown[0]).has_value();
  figure.queries = queries;
  if (figure.metric) figure.up = UpOf(map, shown);  // the world's axes, where one of them is about upwards
  if (map.LiveComponents().size() > shown.size()) absl::StrAppend(&figure.title, " (", NameComponents(shown), ")");
  map.points().ForEach([&](const auto& point) {
    const ComponentId component = map.keyframe(point->reference.keyframe).component;
    if (is_shown(component)) figure.points_m.push_back(world_from(component) * point->position);
  });

  std::vector<const map::Keyframe*> keyframes;
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (is_shown(keyframe->component)) keyframes.push_back(keyframe.get());
  });
  std::sort(keyframes.begin(), keyframes.end(), [](const auto* a, const auto* b) {
    return a->session != b->session ? a->session < b->session : a->time_ns < b->time_ns;
  });
  std::map<KeyframeId, std::size_t> place;
  std::map<SessionId, int> group;
  for (const auto& [id, session] : map.sessions()) {
    group.emplace(id, static_cast<int>(group.size()));
    figure.group_labels.push_back(absl::StrCat("session ", id.value(), ": ", session.source));
  }
  for (const map::Keyframe* keyframe : keyframes) {
    place.emplace(keyframe->id, figure.keyframes.size());
    figure.keyframes.push_back({world_from(keyframe->component).TransformPose(keyframe->camera_from_map.Inverse()),
                                group.at(keyframe->session)});
  }
  for (const map::Keyframe* keyframe : keyframes) {
    for (const map::CovisibilityEdge& edge : keyframe->covisible) {
      if (edge.keyframe < keyframe->id || edge.shared_points < map::kMinCovisiblePoints) continue;
      figure.covisible.emplace_back(place.at(keyframe->id), place.at(edge.keyframe));
    }
  }
  plot::FigureOptions options;
  options.overwrite = true;
  return plot::WriteMapFigure(figure, path, options);
}

absl::Status DrawAte(const eval::AteResult& result, const std::vector<io::StampedPose>& groundtruth,
                     const std::string& title, const std::string& path) {
  plot::TrajectoryFigure figure;
  figure.title = title;
  for (const eval::AtePose& pose : result.poses) {
    figure.estimate.push_back({pose.time_ns, pose.aligned.translation(), pose.error_m});
  }
  for (const io::StampedPose& pose : groundtruth) {
    figure.groundtruth.emplace_back(pose.time_ns, pose.world_from_camera.translation());
  }
  plot::FigureOptions options;
  options.overwrite = true;
  return plot::WriteTrajectoryFigure(figure, path, options);
}

}  // namespace cairn::cli

#include "exchange/reconstruction.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "absl/strings/str_format.h"
#include "inspect/measures.h"

namespace cairn::exchange {
namespace {

ModelImage ToImage(const map::Snapshot& map, const map::Keyframe& keyframe) {
  ModelImage image;
  image.id = keyframe.id.value();
  image.camera = keyframe.camera.value();
  image.name = absl::StrFormat("s%u_%06d.png", keyframe.session.value(), keyframe.frame_index);
  image.time_ns = keyframe.time_ns;
  image.camera_from_world = inspect::PlacedPose(map, keyframe).Inverse();
  for (std::size_t i = 0; i < keyframe.points.size(); ++i) {
    const image::Keypoint& keypoint = keyframe.keypoints()[i];
    image.keypoints.emplace_back(keypoint.x_px, keypoint.y_px);
    image.points.push_back(keyframe.points[i].value());
  }
  return image;
}

ModelPoint ToPoint(const map::Snapshot& map, const map::MapPoint& point) {
  ModelPoint model;
  model.id = point.id.value();
  model.position = inspect::Placed(map, inspect::ComponentOf(map, point), point.position);
  double sum = 0.0, squares = 0.0;
  int count = 0;
  for (const map::Observation& observation : point.observations) {
    model.track.push_back({observation.keyframe.value(), observation.feature});
    const auto measured = inspect::Measure(map, map.keyframe(observation.keyframe), observation.feature);
    if (!measured) continue;
    sum += measured->error_px.norm();
    squares += measured->error_px.squaredNorm();
    ++count;
  }
  if (count > 0) {
    model.error_mean_px = sum / count;
    model.error_rms_px = std::sqrt(squares / count);
  }
  return model;
}

}  // namespace

absl::StatusOr<Reconstruction> FromMap(const map::Snapshot& map, ComponentId component) {
  if (component && map.NumKeyframes(component) == 0) {
    return absl::NotFoundError(absl::StrCat("the map has no component ", component.value(), " with keyframes"));
  }
  const std::vector<ComponentId> chosen =
      component ? std::vector<ComponentId>{component} : inspect::TogetherInOneFrame(map);
  if (chosen.empty()) return absl::NotFoundError("the map has no keyframes");
  Reconstruction model;
  model.metric = map.WorldFrom(chosen[0]).has_value();
  const auto is_chosen = [&](ComponentId id) { return std::ranges::find(chosen, id) != chosen.end(); };
  model.left_out = inspect::LeftOutBesides(map, chosen);
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (!is_chosen(keyframe->component)) return;
    model.images.push_back(ToImage(map, *keyframe));
    model.cameras.try_emplace(keyframe->camera.value(), Camera::FromPinhole(map.pinhole(keyframe->camera)));
  });
  map.points().ForEach([&](const auto& point) {
    if (is_chosen(inspect::ComponentOf(map, *point))) model.points.push_back(ToPoint(map, *point));
  });
  return model;
}

ModelErrors MeasureErrors(const Reconstruction& model) {
  std::unordered_map<std::uint32_t, const ModelImage*> images;
  for (const ModelImage& image : model.images) images.emplace(image.id, &image);
  ModelErrors errors;
  double squares = 0.0, sum = 0.0, of_points = 0.0;
  for (const ModelPoint& point : model.points) {
    of_points += point.error_mean_px;
    for (const ModelObservation& observation : point.track) {
      const ModelImage& image = *images.at(observation.image);
      const auto pixel = model.cameras.at(image.camera).Project(image.camera_from_world * point.position);
      if (!pixel) continue;
      const double error = (*pixel - image.keypoints[observation.keypoint]).norm();
      squares += error * error;
      sum += error;
      ++errors.observations;
    }
  }
  if (errors.observations > 0) {
    errors.rms_px = std::sqrt(squares / static_cast<double>(errors.observations));
    errors.mean_px = sum / static_cast<double>(errors.observations);
  }
  if (!model.points.empty()) errors.mean_of_points_px = of_points / static_cast<double>(model.points.size());
  return errors;
}

}  // namespace cairn::exchange

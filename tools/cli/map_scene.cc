#include "cli/map_scene.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "absl/strings/str_format.h"
#include "inspect/measures.h"
#include "plot/projection.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

bool IsAmong(ComponentId id, const std::vector<ComponentId>& components) {
  return std::ranges::find(components, id) != components.end();
}

// Where a value lies between the smallest and the largest of most of them.
class Shade {
 public:
  explicit Shade(std::vector<double> values) {
    if (values.empty()) return;
    std::ranges::sort(values);
    low_ = values[values.size() / 50];
    high_ = values[values.size() - 1 - values.size() / 50];
  }
  plot::Color operator()(double value) const {
    return plot::Sequential(high_ > low_ ? std::clamp((value - low_) / (high_ - low_), 0.0, 1.0) : 0.5);
  }
  double low() const { return low_; }
  double high() const { return high_; }

 private:
  double low_ = 0.0, high_ = 0.0;
};

std::string AgeText(double seconds) {
  if (seconds >= 2.0 * 86400.0) return absl::StrFormat("%.1f days", seconds / 86400.0);
  if (seconds >= 2.0 * 3600.0) return absl::StrFormat("%.1f h", seconds / 3600.0);
  return absl::StrFormat("%.1f s", seconds);
}

// A value per keyframe and point, with what it is.
struct SceneValues {
  std::string label;
  std::map<KeyframeId, double> keyframes;
  std::map<PointId, double> points;
};

SceneValues ValuesOf(const map::Snapshot& map, const std::vector<ComponentId>& components, SceneColors colors) {
  SceneValues values;
  std::optional<TimeNs> first;
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (IsAmong(keyframe->component, components))
      first = std::min(first.value_or(keyframe->time_ns), keyframe->time_ns);
  });
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (!IsAmong(keyframe->component, components)) return;
    double& value = values.keyframes[keyframe->id];
    if (colors == SceneColors::kAge) value = ToSeconds(keyframe->time_ns - *first);
    if (colors == SceneColors::kError) value = inspect::ErrorRmsPx(inspect::Measure(map, *keyframe)).value_or(0.0);
    if (colors == SceneColors::kObservations) value = inspect::NumPoints(*keyframe);
  });
  map.points().ForEach([&](const auto& point) {
    if (!IsAmong(inspect::ComponentOf(map, *point), components)) return;
    double& value = values.points[point->id];
    if (colors == SceneColors::kAge) value = ToSeconds(map.keyframe(point->observations[0].keyframe).time_ns - *first);
    if (colors == SceneColors::kError) value = inspect::ErrorRmsPx(map, *point).value_or(0.0);
    if (colors == SceneColors::kObservations) value = static_cast<double>(point->observations.size());
  });
  return values;
}

template <class Id>
Shade ShadeOf(const std::map<Id, double>& values) {
  std::vector<double> all;
  for (const auto& [id, value] : values) all.push_back(value);
  return Shade(std::move(all));
}

plot::SceneScale ScaleOf(SceneColors colors, const Shade& points, const Shade& keyframes) {
  switch (colors) {
    case SceneColors::kAge:
      return {"image taken after", AgeText(keyframes.low()), AgeText(keyframes.high())};
    case SceneColors::kError:
      return {"reprojection error", absl::StrFormat("%.1f px", points.low()),
              absl::StrFormat("%.1f px", points.high())};
    case SceneColors::kObservations:
      return {"points seen by (cameras: seeing)", absl::StrFormat("%.0f (%.0f)", points.low(), keyframes.low()),
              absl::StrFormat("%.0f keyframes (%.0f points)", points.high(), keyframes.high())};
    case SceneColors::kSession:
      break;
  }
  return {};
}

void ColorBySession(const map::Snapshot& map, const std::vector<ComponentId>& components, plot::SceneFigure* figure) {
  std::map<SessionId, int> group;
  std::vector<const map::Keyframe*> keyframes;
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (!IsAmong(keyframe->component, components)) return;
    keyframes.push_back(keyframe.get());
    group.emplace(keyframe->session, 0);
  });
  std::ranges::stable_sort(keyframes, {}, [](const map::Keyframe* k) { return std::pair(k->session, k->time_ns); });
  int next = 0;
  for (auto& [id, index] : group) {
    index = next++;
    const std::string source = text::Cut(text::Shown(map.sessions().at(id).source), 32);
    figure->legend.push_back({absl::StrCat("session ", id.value(), source.empty() ? "" : ": ", source),
                              plot::CategoryColor(index), plot::LegendEntry::Mark::kFrustum});
  }
  for (std::size_t i = 0; i < keyframes.size(); ++i) {
    const map::Keyframe& keyframe = *keyframes[i];
    const SE3 pose = inspect::PlacedPose(map, keyframe);
    const plot::Color color = plot::CategoryColor(group.at(keyframe.session));
    if (i > 0 && keyframes[i - 1]->session == keyframe.session && keyframes[i - 1]->component == keyframe.component) {
      figure->lines.push_back(
          {figure->cameras.back().scene_from_camera.translation(), pose.translation(), color.WithAlpha(0.6), 1.0});
    }
    figure->cameras.push_back({pose, color});
  }
  map.points().ForEach([&](const auto& point) {
    const ComponentId component = inspect::ComponentOf(map, *point);
    if (!IsAmong(component, components)) return;
    figure->points.push_back({inspect::Placed(map, component, point->position), plot::Color{0.25, 0.25, 0.30, 0.42}});
  });
}

void ColorByValue(const map::Snapshot& map, const std::vector<ComponentId>& components, SceneColors colors,
                  plot::SceneFigure* figure) {
  const SceneValues values = ValuesOf(map, components, colors);
  const Shade points = ShadeOf(values.points), keyframes = ShadeOf(values.keyframes);
  figure->scale = ScaleOf(colors, points, keyframes);
  // The same thing is told of both where it is the same.
  const bool one = colors != SceneColors::kObservations;
  const Shade& of_keyframes = one && colors == SceneColors::kError ? points : keyframes;
  const Shade& of_points = colors == SceneColors::kAge ? keyframes : points;
  for (const auto& [id, value] : values.points) {
    const map::MapPoint& point = map.point(id);
    figure->points.push_back(
        {inspect::Placed(map, inspect::ComponentOf(map, point), point.position), of_points(value).WithAlpha(0.7)});
  }
  for (const auto& [id, value] : values.keyframes) {
    figure->cameras.push_back({inspect::PlacedPose(map, map.keyframe(id)), of_keyframes(value)});
  }
}

// One character has eight dots, numbered as Unicode has them: the left column 1, 2, 3, 7, the right one 4, 5, 6, 8.
std::string Utf8Braille(unsigned dots) {
  const unsigned code = 0x2800 + dots;
  return {static_cast<char>(0xE0 | (code >> 12)), static_cast<char>(0x80 | ((code >> 6) & 0x3F)),
          static_cast<char>(0x80 | (code & 0x3F))};
}

}  // namespace

Vector3d UpOf(const map::Snapshot& map, const std::vector<ComponentId>& components) {
  Vector3d up = Vector3d::Zero();
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (IsAmong(keyframe->component, components)) up -= inspect::PlacedPose(map, *keyframe).RotationMatrix().col(1);
  });
  if (!(up.norm() > 1e-6)) return Vector3d::UnitZ();
  up.normalize();
  Eigen::Index axis = 0;
  const double cosine = up.cwiseAbs().maxCoeff(&axis);
  constexpr double kNear = 0.94;  // 20 degrees: cameras look down a little more often than up
  if (components.empty() || !map.WorldFrom(components[0]) || cosine < kNear) return up;
  return std::copysign(1.0, up[axis]) * Vector3d::Unit(axis);
}

const char* UnitOf(const map::Snapshot& map, const std::vector<ComponentId>& components) {
  return !components.empty() && map.WorldFrom(components[0]) ? "m" : "map units";
}

plot::SceneFigure SceneOf(const map::Snapshot& map, const std::vector<ComponentId>& components, SceneColors colors) {
  plot::SceneFigure figure;
  figure.title = text::Shown(map.info().name);
  figure.unit = UnitOf(map, components);
  figure.up = UpOf(map, components);
  if (colors == SceneColors::kSession) {
    ColorBySession(map, components, &figure);
  } else {
    ColorByValue(map, components, colors, &figure);
  }
  figure.subtitle = absl::StrFormat("%d keyframes, %d points", figure.cameras.size(), figure.points.size());
  return figure;
}

std::string BraillePlan(const map::Snapshot& map, const std::vector<ComponentId>& components, int columns) {
  std::vector<Vector3d> centers;
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (IsAmong(keyframe->component, components)) centers.push_back(inspect::PlacedPose(map, *keyframe).translation());
  });
  if (centers.empty() || columns < 4) return "";
  const plot::Projection top = plot::TopView(centers, UpOf(map, components));
  Eigen::Vector2d low = top(centers[0]).head<2>(), high = low;
  for (const Vector3d& center : centers) {
    low = low.cwiseMin(top(center).head<2>());
    high = high.cwiseMax(top(center).head<2>());
  }
  // Dots stand as far apart in both directions; a plan is no taller than it is wide in characters.
  const double width = std::max(high.x() - low.x(), 1e-9), height = std::max(high.y() - low.y(), 0.0);
  const int dots_x = 2 * columns;
  const double step = std::max(width / (dots_x - 1), height / (2.0 * columns - 1));
  const int rows = std::max(1, static_cast<int>(std::ceil((height / step + 1.0) / 4.0)));
  std::vector<unsigned> cells(static_cast<std::size_t>(rows * columns), 0);
  constexpr unsigned kDots[4][2] = {{0x01, 0x08}, {0x02, 0x10}, {0x04, 0x20}, {0x40, 0x80}};
  for (const Vector3d& center : centers) {
    const Eigen::Vector2d at = (top(center).head<2>() - low) / step;
    const int x = std::clamp(static_cast<int>(std::lround(at.x())), 0, dots_x - 1);
    const int y = std::clamp(4 * rows - 1 - static_cast<int>(std::lround(at.y())), 0, 4 * rows - 1);
    cells[static_cast<std::size_t>((y / 4) * columns + x / 2)] |= kDots[y % 4][x % 2];
  }
  std::string plan =
      absl::StrFormat("cameras from above, a line is %.3g %s long\n", step * (dots_x - 1), UnitOf(map, components));
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      plan += Utf8Braille(cells[static_cast<std::size_t>(row * columns + column)]);
    }
    plan += "\n";
  }
  return plan;
}

}  // namespace cairn::cli

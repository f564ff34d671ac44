#include "inspect/statistics.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "inspect/measures.h"

namespace cairn::inspect {
namespace {

double AtShare(const std::vector<double>& sorted, double share) {
  return sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1) + 0.5)];
}

struct OfPoints {
  std::vector<double> observations, sessions, seconds, error, parallax, depth, found;
};

OfPoints MeasurePoints(const map::Snapshot& map, const std::vector<ComponentId>& together, SessionId session) {
  OfPoints of;
  map.points().ForEach([&](const auto& point) {
    const map::Keyframe& reference = map.keyframe(point->reference.keyframe);
    if (session && reference.session != session) return;
    of.observations.push_back(static_cast<double>(point->observations.size()));
    std::set<SessionId> sessions;
    TimeNs first_ns = reference.time_ns, last_ns = first_ns;  // in the session of the reference
    for (const map::Observation& observation : point->observations) {
      const map::Keyframe& keyframe = map.keyframe(observation.keyframe);
      sessions.insert(keyframe.session);
      if (keyframe.session != reference.session) continue;
      first_ns = std::min(first_ns, keyframe.time_ns);
      last_ns = std::max(last_ns, keyframe.time_ns);
    }
    of.sessions.push_back(static_cast<double>(sessions.size()));
    of.seconds.push_back(ToSeconds(last_ns - first_ns));
    if (const auto error = ErrorRmsPx(map, *point)) of.error.push_back(*error);
    of.parallax.push_back(ParallaxDeg(map, *point));
    if (std::ranges::find(together, reference.component) != together.end())
      of.depth.push_back(PlacedScale(map, reference.component) * (point->position - reference.CenterInMap()).norm());
    if (point->times_visible > 0) of.found.push_back(1.0 * point->times_found / point->times_visible);
  });
  return of;
}

}  // namespace

Distribution Distribute(std::string name, std::string what, std::vector<double> values, bool whole) {
  Distribution d;
  d.name = std::move(name);
  d.what = std::move(what);
  std::erase_if(values, [](double value) { return !std::isfinite(value); });
  d.count = static_cast<std::int64_t>(values.size());
  if (values.empty()) return d;
  std::sort(values.begin(), values.end());
  double sum = 0.0;
  for (const double value : values) sum += value;
  d.min = values.front();
  d.max = values.back();
  d.mean = sum / static_cast<double>(values.size());
  d.median = AtShare(values, 0.5);
  d.p90 = AtShare(values, 0.9);
  const double high = AtShare(values, 0.99);
  d.low = d.min;
  d.step = whole ? std::max(1.0, std::ceil((high - d.low + 1.0) / kBins)) : (high - d.low) / kBins;
  const double width = whole ? high - d.low + 1.0 : high - d.low;
  const int bins = d.step > 0.0 ? std::clamp(static_cast<int>(std::ceil(width / d.step - 1e-9)), 1, kBins) : 1;
  d.bins.assign(static_cast<std::size_t>(bins), 0);
  for (const double value : values) {
    const double at = d.step > 0.0 ? (value - d.low) / d.step : 0.0;
    ++d.bins[static_cast<std::size_t>(std::clamp(std::floor(at), 0.0, static_cast<double>(bins - 1)))];
  }
  return d;
}

std::vector<Distribution> Statistics(const map::Snapshot& map, SessionId session) {
  const std::vector<ComponentId> together = TogetherInOneFrame(map);
  OfPoints of = MeasurePoints(map, together, session);
  std::vector<double> features, points, covisible, shared, errors;
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (session && keyframe->session != session) return;
    features.push_back(static_cast<double>(keyframe->points.size()));
    points.push_back(NumPoints(*keyframe));
    covisible.push_back(NumCovisible(*keyframe));
    if (!keyframe->covisible.empty()) shared.push_back(keyframe->covisible[0].shared_points);
    if (const auto error = ErrorRmsPx(Measure(map, *keyframe))) errors.push_back(*error);
  });
  const std::string unit = !together.empty() && map.WorldFrom(together[0]) ? "m" : "map units";
  const bool all = LeftOutBesides(map, together).components == 0;
  Distribution depth = Distribute(
      "depth",
      absl::StrCat("of a point from its reference keyframe, ", unit, all ? "" : ", without components in other frames"),
      std::move(of.depth), false);
  depth.unit = unit;
  return {Distribute("observations_per_point", "keyframes that see a point", std::move(of.observations), true),
          Distribute("sessions_per_point", "sessions that see a point", std::move(of.sessions), true),
          Distribute("track_s", "from first to last sight in a session", std::move(of.seconds), false),
          Distribute("point_error_px", "reprojection error of a point, RMS", std::move(of.error), false),
          Distribute("parallax_deg", "largest angle between two sights", std::move(of.parallax), false),
          std::move(depth),
          Distribute("found_share", "of the times it was expected", std::move(of.found), false),
          Distribute("features_per_keyframe", "features of a keyframe", std::move(features), true),
          Distribute("points_per_keyframe", "points seen by a keyframe", std::move(points), true),
          Distribute("covisible_keyframes", "with 15 points in common", std::move(covisible), true),
          Distribute("shared_points", "with the best neighbour", std::move(shared), true),
          Distribute("keyframe_error_px", "reprojection error in a keyframe, RMS", std::move(errors), false)};
}

}  // namespace cairn::inspect

#include "tracking/group_matcher.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <unordered_map>

#include "image/hamming.h"
#include "image/matching.h"

namespace cairn::tracking {
namespace {

// Every observation that the group's keyframes have of a point, ordered by node so that those to compare are
// neighbours.
struct ObservationTable {
  std::vector<place::NodeId> node;
  std::vector<image::Descriptor> descriptor;
  std::vector<std::uint32_t> point;  // index into `points`
  std::vector<float> angle_rad;
  std::vector<const map::MapPoint*> points;
};

ObservationTable Collect(const map::Snapshot& map, const PlaceIndex& places, std::span<const KeyframeId> group) {
  struct Row {
    place::NodeId node;
    const map::Keyframe* keyframe;
    std::uint32_t feature;
    std::uint32_t point;
  };
  std::vector<Row> rows;
  ObservationTable table;
  std::unordered_map<PointId, std::uint32_t> index_of;
  for (const KeyframeId id : group) {
    const map::Keyframe* keyframe = map.keyframes().Find(id);
    const auto nodes = places.NodesOf(id);
    if (keyframe == nullptr || nodes.size() != keyframe->points.size()) continue;
    for (std::uint32_t i = 0; i < nodes.size(); ++i) {
      if (!keyframe->points[i]) continue;
      const map::MapPoint* point = map.points().Find(keyframe->points[i]);
      if (point == nullptr) continue;
      const auto [entry, is_new] = index_of.try_emplace(point->id, static_cast<std::uint32_t>(table.points.size()));
      if (is_new) table.points.push_back(point);
      rows.push_back({nodes[i], keyframe, i, entry->second});
    }
  }
  std::stable_sort(rows.begin(), rows.end(), [](const Row& a, const Row& b) { return a.node < b.node; });
  for (const Row& row : rows) {
    table.node.push_back(row.node);
    table.descriptor.push_back(row.keyframe->descriptors()[row.feature]);
    table.point.push_back(row.point);
    table.angle_rad.push_back(row.keyframe->keypoints()[row.feature].angle_rad);
  }
  return table;
}

struct Nearest {
  std::uint32_t row = 0;
  int distance = 257;
  int other_distance = 257;  // of the best point at another place
};

// Of the rows from `begin` on, whose distances are given. Nothing farther than `max_distance` counts as nearest.
Nearest FindNearest(const ObservationTable& table, std::size_t begin, std::span<const std::uint16_t> distances,
                    int max_distance, const Vector3d& group_center, double same_place) {
  Nearest best;
  // Signed 16-bit minima are one SSE2 instruction per eight: this loop is what most of the time goes to.
  std::int16_t least = std::numeric_limits<std::int16_t>::max();
  for (const std::uint16_t distance : distances) least = std::min(least, static_cast<std::int16_t>(distance));
  if (least > max_distance) return best;
  best.distance = least;
  const auto nearest = std::find(distances.begin(), distances.end(), static_cast<std::uint16_t>(least));
  best.row = static_cast<std::uint32_t>(begin + static_cast<std::size_t>(nearest - distances.begin()));
  const std::uint32_t best_point = table.point[best.row];
  const Vector3d& position = table.points[best_point]->position;
  const double near = same_place * (position - group_center).norm();
  for (std::size_t i = 0; i < distances.size(); ++i) {
    if (distances[i] >= best.other_distance) continue;
    const std::uint32_t point = table.point[begin + i];
    if (point == best_point || (table.points[point]->position - position).squaredNorm() < near * near) continue;
    best.other_distance = distances[i];
  }
  return best;
}

std::vector<GroupMatch> KeepRotations(const ObservationTable& table, const image::Features& query,
                                      std::vector<GroupMatch> matches, std::span<const std::uint32_t> rows) {
  // Match i pairs the query's keypoint with the keypoint of the observation that was nearest.
  std::vector<image::Keypoint> a(matches.size()), b(matches.size());
  std::vector<image::FeatureMatch> pairs(matches.size());
  for (std::uint32_t i = 0; i < matches.size(); ++i) {
    a[i] = query.keypoints[matches[i].feature];
    b[i].angle_rad = table.angle_rad[rows[i]];
    pairs[i] = {i, i, matches[i].distance};
  }
  std::vector<GroupMatch> kept;
  for (const image::FeatureMatch& pair : image::KeepConsistentRotations(a, b, std::move(pairs))) {
    kept.push_back(matches[pair.a]);
  }
  return kept;
}

}  // namespace

absl::Status GroupMatchOptions::Validate() const {
  if (max_distance < 0 || max_distance > 256) {
    return absl::InvalidArgumentError("group matching: max_distance must be 0 to 256 bits");
  }
  if (!(max_ratio > 0.0 && max_ratio <= 1.0)) {
    return absl::InvalidArgumentError("group matching: max_ratio must be in (0, 1]");
  }
  if (!(same_place >= 0.0)) return absl::InvalidArgumentError("group matching: same_place must not be negative");
  return absl::OkStatus();
}

std::vector<GroupMatch> MatchGroup(const map::Snapshot& map, const PlaceIndex& places,
                                   std::span<const KeyframeId> group, const image::Features& query,
                                   std::span<const place::NodeId> nodes, const GroupMatchOptions& options) {
  const ObservationTable table = Collect(map, places, group);
  if (table.node.empty()) return {};
  const Vector3d center = map.keyframe(group.front()).CenterInMap();

  std::vector<GroupMatch> best_of_point(table.points.size());
  std::vector<std::uint32_t> row_of_point(table.points.size());
  std::vector<std::uint16_t> distances;
  for (std::uint32_t feature = 0; feature < nodes.size(); ++feature) {
    const auto [first, last] = std::equal_range(table.node.begin(), table.node.end(), nodes[feature]);
    if (first == last) continue;
    const auto begin = static_cast<std::size_t>(first - table.node.begin());
    distances.resize(static_cast<std::size_t>(last - first));
    image::HammingDistances(query.descriptors[feature], &table.descriptor[begin], distances.size(), distances.data());
    const Nearest nearest = FindNearest(table, begin, distances, options.max_distance, center, options.same_place);
    if (nearest.distance > 256) continue;
    const float ratio = static_cast<float>(nearest.distance) / static_cast<float>(nearest.other_distance);
    if (options.max_ratio < 1.0 && ratio > options.max_ratio) continue;
    GroupMatch& holder = best_of_point[table.point[nearest.row]];
    if (holder.point && holder.distance <= nearest.distance) continue;
    holder = {feature, table.points[table.point[nearest.row]]->id, nearest.distance, ratio};
    row_of_point[table.point[nearest.row]] = nearest.row;
  }

  std::vector<GroupMatch> matches;
  std::vector<std::uint32_t> rows;
  for (std::size_t i = 0; i < best_of_point.size(); ++i) {
    if (!best_of_point[i].point) continue;
    matches.push_back(best_of_point[i]);
    rows.push_back(row_of_point[i]);
  }
  if (options.check_rotation) matches = KeepRotations(table, query, std::move(matches), rows);
  std::sort(matches.begin(), matches.end(), [](const GroupMatch& a, const GroupMatch& b) {
    return a.ratio != b.ratio ? a.ratio < b.ratio : a.feature < b.feature;
  });
  return matches;
}

}  // namespace cairn::tracking

#include "tracking/group_matcher.h"

#include <algorithm>
#include <bit>
#include <limits>
#include <optional>
#include <utility>

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

// Rows of points, found by id: a hash table with linear probing, as the lookup per observation counts.
class PointRows {
 public:
  explicit PointRows(std::size_t most) : slots_(std::bit_ceil(2 * most + 2)) {}

  // The row of a point; `next` is the one that it gets if it is new.
  std::uint32_t RowOf(PointId id, std::uint32_t next) {
    std::size_t slot = id.value() * kMultiplier % slots_.size();
    while (slots_[slot].first && slots_[slot].first != id) slot = (slot + 1) % slots_.size();
    if (!slots_[slot].first) slots_[slot] = {id, next};
    return slots_[slot].second;
  }

 private:
  static constexpr std::size_t kMultiplier = 0x9E3779B1u;  // Knuth's, of neighbouring ids far apart
  std::vector<std::pair<PointId, std::uint32_t>> slots_;
};

ObservationTable Collect(const map::Snapshot& map, const PlaceIndex& places, std::span<const KeyframeId> group) {
  struct Row {
    const image::Features* features;
    std::uint32_t feature;
    std::uint32_t point;
  };
  std::size_t most = 0;
  for (const KeyframeId id : group) {
    if (const map::Keyframe* keyframe = map.keyframes().Find(id)) most += keyframe->features.size();
  }
  std::vector<Row> rows;
  std::vector<std::pair<place::NodeId, std::uint32_t>> order;  // node and row
  rows.reserve(most);
  order.reserve(most);
  ObservationTable table;
  map::FeatureLook look;
  PointRows rows_of_points(most);
  for (const KeyframeId id : group) {
    const map::Keyframe* keyframe = map.keyframes().Find(id);
    if (keyframe == nullptr) continue;
    const std::vector<place::NodeId> nodes = places.NodesOf(*keyframe);
    if (nodes.size() != keyframe->points.size()) continue;
    const image::Features& features = look.Of(keyframe->features).features;
    for (std::uint32_t i = 0; i < nodes.size(); ++i) {
      if (!keyframe->points[i]) continue;
      const auto next = static_cast<std::uint32_t>(table.points.size());
      const std::uint32_t row = rows_of_points.RowOf(keyframe->points[i], next);
      if (row == next) table.points.push_back(map.points().Find(keyframe->points[i]));
      if (table.points[row] == nullptr) continue;
      order.emplace_back(nodes[i], static_cast<std::uint32_t>(rows.size()));
      rows.push_back({&features, i, row});
    }
  }
  std::sort(order.begin(), order.end());
  for (const auto& [node, i] : order) {
    const Row& row = rows[i];
    table.node.push_back(node);
    table.descriptor.push_back(row.features->descriptors[row.feature]);
    table.point.push_back(row.point);
    table.angle_rad.push_back(row.features->keypoints[row.feature].angle_rad);
  }
  return table;
}

struct Nearest {
  std::uint32_t row = 0;
  int distance = 257;
  int other_distance = 257;  // of the best point at another place
};

float RatioOf(int distance, int other_distance) {
  return static_cast<float>(distance) / static_cast<float>(other_distance);
}

// Of the rows from `begin` on, whose distances are given; no answer where the nearest is too far, or another place
// nearly as near.
std::optional<Nearest> FindNearest(const ObservationTable& table, std::size_t begin,
                                   std::span<const std::uint16_t> distances, const Vector3d& group_center,
                                   const GroupMatchOptions& options) {
  Nearest best;
  // Signed 16-bit minima are one SSE2 instruction per eight: this loop is what most of the time goes to.
  std::int16_t least = std::numeric_limits<std::int16_t>::max();
  for (const std::uint16_t distance : distances) least = std::min(least, static_cast<std::int16_t>(distance));
  if (least > options.max_distance) return std::nullopt;
  best.distance = least;
  const auto nearest = std::find(distances.begin(), distances.end(), static_cast<std::uint16_t>(least));
  best.row = static_cast<std::uint32_t>(begin + static_cast<std::size_t>(nearest - distances.begin()));
  const std::uint32_t best_point = table.point[best.row];
  const Vector3d& position = table.points[best_point]->position;
  const double near = options.same_place * (position - group_center).norm();
  for (std::size_t i = 0; i < distances.size(); ++i) {
    if (distances[i] >= best.other_distance) continue;
    const std::uint32_t point = table.point[begin + i];
    if (point == best_point || (table.points[point]->position - position).squaredNorm() < near * near) continue;
    best.other_distance = distances[i];
    if (options.max_ratio < 1.0 && RatioOf(best.distance, best.other_distance) > options.max_ratio) return std::nullopt;
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
    const std::optional<Nearest> nearest = FindNearest(table, begin, distances, center, options);
    if (!nearest) continue;
    const std::uint32_t point = table.point[nearest->row];
    GroupMatch& holder = best_of_point[point];
    if (holder.point && holder.distance <= nearest->distance) continue;
    holder = {feature, table.points[point]->id, nearest->distance, RatioOf(nearest->distance, nearest->other_distance)};
    row_of_point[point] = nearest->row;
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

#include "map/changed_rows.h"

#include <memory>
#include <utility>

namespace cairn::map {
namespace {

bool Same(const SE3& a, const SE3& b) {
  return a.rotation().coeffs() == b.rotation().coeffs() && a.translation() == b.translation();
}

bool SameFeatures(const Keyframe& a, const Keyframe& b) {
  return a.features == b.features || *a.features == *b.features;
}

// All but features and points.
bool SameRow(const Keyframe& a, const Keyframe& b) {
  return a.session == b.session && a.camera == b.camera && a.component == b.component && a.time_ns == b.time_ns &&
         a.frame_index == b.frame_index && a.direct_segment == b.direct_segment && a.parent == b.parent &&
         Same(a.camera_from_map, b.camera_from_map) && Same(a.camera_from_direct, b.camera_from_direct) &&
         a.children == b.children && a.covisible == b.covisible;
}

bool Same(const MapPoint& a, const MapPoint& b) {
  return a.position == b.position && a.observations == b.observations && a.times_visible == b.times_visible &&
         a.times_found == b.times_found && a.reference == b.reference && a.descriptor == b.descriptor &&
         a.mean_view_direction == b.mean_view_direction && a.pixel_size == b.pixel_size;
}

bool Same(const GeoAnchor& a, const GeoAnchor& b) {
  return a.latitude_deg == b.latitude_deg && a.longitude_deg == b.longitude_deg && a.height_m == b.height_m &&
         a.enu_from_world.coeffs() == b.enu_from_world.coeffs();
}

bool Same(const MapInfo& a, const MapInfo& b) {
  return a.id == b.id && a.name == b.name && a.software_version == b.software_version &&
         a.created_unix_ns == b.created_unix_ns && a.orb == b.orb && a.vocabulary_hash == b.vocabulary_hash &&
         a.geo_anchor.has_value() == b.geo_anchor.has_value() && (!a.geo_anchor || Same(*a.geo_anchor, *b.geo_anchor));
}

// Of two small tables.
template <class IdType, class T>
std::vector<IdType> Different(const std::map<IdType, T>& before, const std::map<IdType, T>& after) {
  std::vector<IdType> ids;
  if (&before == &after) return ids;
  auto was = before.begin();
  auto is = after.begin();
  while (was != before.end() || is != after.end()) {
    if (is == after.end() || (was != before.end() && was->first < is->first)) {
      ids.push_back((was++)->first);
    } else if (was == before.end() || is->first < was->first) {
      ids.push_back((is++)->first);
    } else {
      if (!(was->second == is->second)) ids.push_back(is->first);
      ++was, ++is;
    }
  }
  return ids;
}

}  // namespace

ChangedRows AllRows(const Snapshot& map) {
  ChangedRows rows;
  rows.whole = rows.info = true;
  for (const auto& [id, camera] : map.cameras()) rows.cameras.push_back(id);
  for (const auto& [id, session] : map.sessions()) rows.sessions.push_back(id);
  for (const auto& [id, component] : map.components()) rows.components.push_back(id);
  map.keyframes().ForEach([&](const auto& keyframe) { rows.keyframes.push_back({keyframe->id, true, true}); });
  map.points().ForEach([&](const auto& point) { rows.points.push_back(point->id); });
  return rows;
}

ChangedRows RowsBetween(const Snapshot& before, const Snapshot& after) {
  ChangedRows rows;
  rows.base = before.revision();
  rows.info = &before.info() != &after.info() && !Same(before.info(), after.info());
  rows.cameras = Different(before.cameras(), after.cameras());
  rows.sessions = Different(before.sessions(), after.sessions());
  rows.components = Different(before.components(), after.components());
  before.keyframes().ForEachDifference(after.keyframes(), [&](const auto& was, const auto& is) {
    if (was == nullptr || is == nullptr) {
      rows.keyframes.push_back({(was ? was : is)->id, is != nullptr, is != nullptr});
      return;
    }
    const ChangedKeyframe changed{is->id, !SameFeatures(*was, *is), was->points != is->points};
    if (changed.features || changed.points || !SameRow(*was, *is)) rows.keyframes.push_back(changed);
  });
  before.points().ForEachDifference(after.points(), [&](const auto& was, const auto& is) {
    if (was == nullptr || is == nullptr || !Same(*was, *is)) rows.points.push_back((was ? was : is)->id);
  });
  return rows;
}

}  // namespace cairn::map

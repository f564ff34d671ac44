// A name for what a map contains: equal for equal content, whoever made it, when, in how many steps, and however the
// file is laid out.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "base/status.h"
#include "map/snapshot.h"

namespace cairn::store {

class Database;
struct MapRow;

// 32 hex digits: xxHash's XXH3-128 over cameras, sessions, keyframes (poses, features, words, points, tree,
// covisibility), points, ORB parameters, vocabulary hash and world_from_map, in order of id. Left out: the map's id,
// name, revision and next free ids, software versions, settings and wall-clock times.
std::string ContentDigest(const map::Snapshot& snapshot);

// The same of a map whose keyframes and points go by, one after another.
class DigestHasher;
class ContentDigester {
 public:
  // Of a map with the cameras, sessions and components of `heads`, whose keyframes and points are not looked at.
  ContentDigester(const map::Snapshot& heads, std::size_t num_keyframes);
  ~ContentDigester();

  // All keyframes with their neighbours, ascending; then this; then all points with their reference's keyframe.
  void Add(const map::Keyframe& keyframe, const map::KeyframeFeatures& features);
  void BeginPoints(std::size_t num_points);
  void Add(const map::MapPoint& point);
  std::string Finish();

 private:
  const bool has_parts_;
  const std::unique_ptr<DigestHasher> hasher_;
};

// Whether the rows of a map can be gone through one after another: older formats do not say to which component a
// keyframe belongs, and a bit for each of ids that are far apart would take more memory than the map.
bool CanGoByRows(std::int64_t format, const MapRow& map_row);

// The same of the map in a file for which that is so, of which one keyframe at a time is in memory. Within a read
// transaction. Every row that it depends on is checked.
absl::StatusOr<std::string> DigestOfRows(Database* database);

}  // namespace cairn::store

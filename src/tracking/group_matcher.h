// Matches the features of a query image with the points of a group of covisible keyframes at once, through the nodes of
// the vocabulary tree. A point takes part with the descriptors of all its observations in the group, so that it is
// found from any side it was seen from.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/status.h"
#include "image/feature.h"
#include "map/snapshot.h"
#include "tracking/place_index.h"

namespace cairn::tracking {

struct GroupMatchOptions {
  int max_distance = 80;    // Hamming, bits
  double max_ratio = 0.85;  // best against the best of another place; 1: no such test
  // Two points nearer to each other than this share of their distance from the camera are one place: duplicates of a
  // physical point do not make it ambiguous.
  double same_place = 0.02;
  bool check_rotation = true;  // keep the main modes of the image rotation against the observing keyframes

  absl::Status Validate() const;
};

struct GroupMatch {
  std::uint32_t feature = 0;  // of the query
  PointId point;
  int distance = 0;    // Hamming, bits
  float ratio = 0.0f;  // distance over that of the best of another place: less is more trustworthy
};

// At most one match per feature and per point, the most trustworthy first. `nodes` are the query's, as of
// PlaceIndex::Transform.
std::vector<GroupMatch> MatchGroup(const map::Snapshot& map, const PlaceIndex& places,
                                   std::span<const KeyframeId> group, const image::Features& query,
                                   std::span<const place::NodeId> nodes, const GroupMatchOptions& options = {});

}  // namespace cairn::tracking

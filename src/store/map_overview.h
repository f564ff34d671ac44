// What is in a map and what takes its room, without loading it: tables that are small whatever the size of the map are
// read whole, keyframes and points are counted, and means are those of a sample spread evenly over the ids. Blobs are
// not read: SQLite knows how long they are from the row that refers to them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/status.h"
#include "map/entities.h"
#include "store/map_store.h"

namespace cairn::store {

// Something that takes room in the file of a map.
struct MapPart {
  std::string name;  // "descriptors"
  std::int64_t bytes = 0;
};

// The keyframes that a session has in a component.
struct KeyframeShare {
  SessionId session;
  ComponentId component;
  std::int64_t keyframes = 0;
  TimeNs first_ns = 0;  // of their images
  TimeNs last_ns = 0;
};

// Means over the keyframes looked at; 0 without any.
struct MapQuality {
  std::int64_t keyframes = 0;           // looked at, ...
  bool all = true;                      // ... which are all there are
  double features = 0.0;                // per keyframe ...
  double points = 0.0;                  // ... that observe a point
  double covisible = 0.0;               // per keyframe, other keyframes with map::kMinCovisiblePoints points in common
  double observations_per_point = 0.0;  // of which keyframes there are times points observed in each, over all points
  // Of observations in `error_keyframes` of these keyframes, at the scale of the image.
  std::int64_t error_keyframes = 0;
  double error_rms_px = 0.0;
  double error_median_px = 0.0;
};

struct MapOverview {
  MapSummary summary;
  std::vector<map::MapCamera> cameras;     // ascending by id, as the others
  std::vector<map::Session> sessions;      // with their loops and trajectories
  std::vector<map::Component> components;  // those that were joined to others included
  std::vector<KeyframeShare> shares;       // ascending by session and component
  // Largest first; they come to summary.file_bytes. What depends on the length of rows that were not looked at is
  // estimated from those that were (MapQuality::all).
  std::vector<MapPart> parts;
  MapQuality quality;
  bool has_vocabulary = false;
  std::vector<std::string> notes;  // as MapStore::notes()
};

struct OverviewOptions {
  int sampled_keyframes = 256;  // looked at at most, for means and sizes
  int error_keyframes = 12;     // of these, those whose observations are projected
};

// Of the newest revision of the map at `uri`. A time that grows by about 0.3 us per keyframe (they are counted), and
// in nothing else. Maps of formats before 4, which do not know their components, are loaded. Errors as of OpenMapStore
// and MapStore::LoadSnapshot; what is not looked at may be damaged nevertheless: that is what Verify() is for.
absl::StatusOr<MapOverview> ReadMapOverview(const std::string& uri, const OverviewOptions& options = {});

}  // namespace cairn::store

// What can be said of a stored map without loading it (store/map_overview.h): what is in it, what takes its room, how
// good it is. Values, which a server sends as well.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "map/entities.h"

namespace cairn::map {

struct StoredSummary {
  int format_version = 0;
  Revision revision = 0;
  MapInfo info;
  std::int64_t cameras = 0;
  std::int64_t sessions = 0;
  std::int64_t components = 0;  // those that were joined to others included
  std::int64_t keyframes = 0;
  std::int64_t points = 0;
  std::int64_t covisibility_edges = 0;
  std::int64_t file_bytes = 0;        // of the database, without what a writer has in its write-ahead log
  std::int64_t vocabulary_bytes = 0;  // of these
};

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
  StoredSummary summary;
  std::vector<MapCamera> cameras;     // ascending by id, as the others
  std::vector<Session> sessions;      // with their loops and trajectories
  std::vector<Component> components;  // those that were joined to others included
  std::vector<KeyframeShare> shares;  // ascending by session and component
  // Largest first; they come to summary.file_bytes. What depends on the length of rows that were not looked at is
  // estimated from those that were (MapQuality::all).
  std::vector<MapPart> parts;
  MapQuality quality;
  bool has_vocabulary = false;
  bool being_written = false;      // by a process that has the map open to extend it; where that is known
  std::vector<std::string> notes;  // what a user should know, but no damage
};

}  // namespace cairn::map

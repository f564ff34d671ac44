// What is in a map and what takes its room, without loading it: tables that are small whatever the size of the map are
// read whole, keyframes and points are counted, and means are those of a sample spread evenly over the ids. Blobs are
// not read: SQLite knows how long they are from the row that refers to them.
#pragma once

#include <string>

#include "base/status.h"
#include "map/overview.h"
#include "store/map_store.h"

namespace cairn::store {

using map::KeyframeShare;
using map::MapOverview;
using map::MapPart;
using map::MapQuality;

struct OverviewOptions {
  int sampled_keyframes = 256;  // looked at at most, for means and sizes
  int error_keyframes = 12;     // of these, those whose observations are projected
};

// Of the newest revision of the map at `uri`. A time that grows by about 0.3 us per keyframe (they are counted), and
// in nothing else. Maps of formats before 4, which do not know their components, are loaded. Errors as of OpenMapStore
// and MapStore::LoadSnapshot; what is not looked at may be damaged nevertheless: that is what Verify() is for.
absl::StatusOr<MapOverview> ReadMapOverview(const std::string& uri, const OverviewOptions& options = {});

}  // namespace cairn::store

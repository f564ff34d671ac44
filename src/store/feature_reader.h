// Features of keyframes from a map file, one keyframe at a time, for who holds a map without them.
#pragma once

#include <memory>
#include <string>

#include "base/status.h"
#include "map/feature_cache.h"
#include "store/file_paths.h"
#include "store/sqlite.h"

namespace cairn::store {

// Of the map at `path`, which messages name so; `resolved` as SQLite knows it. It has a connection of its own, so that
// whoever follows the map is not in its way. Features never change (but for keypoints that a lens corrected later
// moves), so no revision is pinned for them. The fault kMoved if another file than `identity` is there.
absl::StatusOr<std::unique_ptr<map::FeatureReader>> OpenFeatureReader(const std::string& path,
                                                                      const std::string& resolved,
                                                                      const FileIdentity& identity);

// The same within a transaction of `database`, which must last longer: of that revision, keypoints included.
absl::StatusOr<std::unique_ptr<map::FeatureReader>> FeatureReaderWithin(Database* database, const std::string& path);

}  // namespace cairn::store

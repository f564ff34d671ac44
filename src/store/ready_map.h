// Reads the map ready to be queried (ready_pages.h): what there is at once, keyframes and points when they are looked
// at.
#pragma once

#include <memory>
#include <string>

#include "base/status.h"
#include "map/entity_source.h"
#include "map/feature_cache.h"
#include "store/file_paths.h"
#include "store/ready_file.h"

namespace cairn::store {

// Keyframes and points of the revision of `index`, from the map at `path`, which messages name so; `resolved` as SQLite
// knows it. It has a connection of its own. What cannot be read, or was written anew since, is told to `cache`, from
// which the features of all keyframes come.
absl::StatusOr<std::shared_ptr<const map::EntitySource>> OpenReadySource(const std::string& path,
                                                                         const std::string& resolved,
                                                                         const FileIdentity& identity, ReadyIndex index,
                                                                         const image::OrbParameters& orb,
                                                                         std::shared_ptr<map::FeatureCache> cache);

}  // namespace cairn::store

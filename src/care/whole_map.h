// Maps as one change: written to a file of their own, or put beside what another map holds.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "base/status.h"
#include "map/delta.h"
#include "map/snapshot.h"
#include "place/vocabulary.h"
#include "store/map_store.h"

namespace cairn::care {

// Everything in `map`, with its ids, as one change of an empty map.
map::Delta AsOneChange(const map::Snapshot& map, const std::string& reason);

// Everything in `from`, as one change of `onto`: ids follow those of `onto`; cameras that are the same become one
// (map/camera_identity.h). `words`: that of `onto`, by which features whose words are another vocabulary's are looked
// up anew; may be null if the two have the same. FailedPrecondition if features are not comparable (other ORB
// parameters), or cameras of one name contradict each other.
absl::StatusOr<map::Delta> Beside(const map::Snapshot& onto, const map::Snapshot& from, const place::Vocabulary* words,
                                  const std::string& reason);

// Ids of a new map, and what it is called; the rest as in `like`.
map::MapInfo NewMapInfo(const map::MapInfo& like, const std::string& name);

// A new map file with the content of `map` under `info`, written and on the disk, which is at its name once the store
// is closed; nothing of it stays if it is not. `vocabulary`: serialised, may be empty. Errors as of
// store::CreateMapStore.
absl::StatusOr<std::unique_ptr<store::MapStore>> PrepareNewMap(const map::Snapshot& map, const map::MapInfo& info,
                                                               const std::string& vocabulary, const std::string& uri,
                                                               bool overwrite, const std::string& reason,
                                                               const store::WriteOptions& write = {});

// The same with the store closed: the file is there, complete, or not at all.
absl::Status WriteNewMap(const map::Snapshot& map, const map::MapInfo& info, const std::string& vocabulary,
                         const std::string& uri, bool overwrite, const std::string& reason,
                         const store::WriteOptions& write = {});

}  // namespace cairn::care

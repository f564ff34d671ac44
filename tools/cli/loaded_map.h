// A map file as verbs that make another map of it need it.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "base/status.h"
#include "map/snapshot.h"
#include "place/vocabulary.h"
#include "store/map_store.h"
#include "tracking/map_view.h"

namespace cairn::cli {

struct LoadedMap {
  std::shared_ptr<const map::Snapshot> map;
  std::shared_ptr<const place::Vocabulary> words;  // null: it has none

  // To be stored with another map.
  std::string Vocabulary() const { return words == nullptr ? std::string() : words->Serialize(); }
  absl::StatusOr<std::shared_ptr<const tracking::MapView>> View() const {
    return tracking::MapView::Create(map, words);
  }
};

// FailedPrecondition if there is nothing in the map yet, or no longer, which `name` names.
absl::Status RequireKeyframes(const std::string& name, const map::Snapshot& map);

// The map for who looks at `few` of its keyframes and points: where it is ready to be queried, only what is looked at
// is read. Else, and when `look` has met what is damaged there, the map as a whole, which takes less than all of it
// piece by piece. `look` must only collect what is to be told: it may be called twice.
absl::Status LookInto(store::MapStore& file, bool few, const std::function<absl::Status(const map::Snapshot&)>& look);

// Errors of the store as they are. What a user should be told goes to standard error, named by `verb`.
absl::StatusOr<LoadedMap> LoadMap(const std::string& verb, const std::string& path);

}  // namespace cairn::cli

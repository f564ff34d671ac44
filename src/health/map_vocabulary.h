// The vocabulary of a stored map. It is half of a small file, and most maps have the one that ships with Cairn: damage
// to it need not cost the map.
#pragma once

#include <memory>
#include <string>

#include "base/status.h"
#include "place/vocabulary.h"
#include "store/map_store.h"

namespace cairn::health {

struct MapVocabulary {
  std::shared_ptr<const place::Vocabulary> words;  // null: the map has none
  std::string note;  // what a user should be told: that the stored one is damaged, and another took its place
};

// The one stored with the map; if that is damaged or missing, the shipped one if it is the same by the map's hash. The
// store's error otherwise.
absl::StatusOr<MapVocabulary> LoadVocabulary(store::MapStore& store);

}  // namespace cairn::health

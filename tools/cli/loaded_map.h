// A map file as verbs that make another map of it need it.
#pragma once

#include <memory>
#include <string>

#include "base/status.h"
#include "map/snapshot.h"
#include "place/vocabulary.h"
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

// Errors of the store as they are. What a user should be told goes to standard error, named by `verb`.
absl::StatusOr<LoadedMap> LoadMap(const std::string& verb, const std::string& path);

}  // namespace cairn::cli

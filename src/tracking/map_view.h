// What a reader needs of one revision of a map: its content, and the index to find places in it. Immutable, shared by
// any number of threads. The view of the next revision is made from the one before and the change between, at a cost in
// proportion to the change, whoever makes it: the writer that publishes it, or a reader that follows a file.
#pragma once

#include <memory>
#include <optional>

#include "base/status.h"
#include "map/delta.h"
#include "map/snapshot.h"
#include "place/vocabulary.h"
#include "tracking/place_index.h"

namespace cairn::tracking {

class MapView {
 public:
  // O(map). `vocabulary` may be null: then no place can be found. Errors as PlaceIndex::Build.
  static absl::StatusOr<std::shared_ptr<const MapView>> Create(std::shared_ptr<const map::Snapshot> map,
                                                               std::shared_ptr<const place::Vocabulary> vocabulary);

  // The same with an index that was built on the way.
  static std::shared_ptr<const MapView> Create(std::shared_ptr<const map::Snapshot> map, PlaceIndex places);

  // The view after `delta`; this one stays as it is. O(delta). Errors as Snapshot::Apply and PlaceIndex::After.
  absl::StatusOr<std::shared_ptr<const MapView>> After(const map::Delta& delta) const;

  Revision revision() const { return map_->revision(); }
  const map::Snapshot& map() const { return *map_; }
  const std::shared_ptr<const map::Snapshot>& snapshot() const { return map_; }
  // Null without a vocabulary.
  const PlaceIndex* places() const { return places_ ? &*places_ : nullptr; }

 private:
  MapView() = default;

  std::shared_ptr<const map::Snapshot> map_;
  std::optional<PlaceIndex> places_;
};

}  // namespace cairn::tracking

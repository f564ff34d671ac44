#include "tracking/map_view.h"

#include <utility>

namespace cairn::tracking {

absl::StatusOr<std::shared_ptr<const MapView>> MapView::Create(std::shared_ptr<const map::Snapshot> map,
                                                               std::shared_ptr<const place::Vocabulary> vocabulary) {
  std::shared_ptr<MapView> view(new MapView);
  if (vocabulary != nullptr) {
    CAIRN_ASSIGN_OR_RETURN(view->places_, PlaceIndex::Build(std::move(vocabulary), *map));
  }
  view->map_ = std::move(map);
  return view;
}

std::shared_ptr<const MapView> MapView::Create(std::shared_ptr<const map::Snapshot> map, PlaceIndex places) {
  std::shared_ptr<MapView> view(new MapView);
  view->map_ = std::move(map);
  view->places_ = std::move(places);
  return view;
}

absl::StatusOr<std::shared_ptr<const MapView>> MapView::After(const map::Delta& delta) const {
  std::shared_ptr<MapView> next(new MapView);
  CAIRN_ASSIGN_OR_RETURN(next->map_, map_->Apply(delta));
  if (places_) {
    CAIRN_ASSIGN_OR_RETURN(next->places_, places_->After(delta, *next->map_));
  }
  return next;
}

}  // namespace cairn::tracking

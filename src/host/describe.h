// What a host tells of its maps.
#pragma once

#include <string>

#include "api/map_service.h"
#include "map/snapshot.h"
#include "store/map_store.h"

namespace cairn::host {

api::MapSummary SummaryOf(const std::string& name, const store::MapSummary& stored);

// All but what the snapshot does not know: the name, the format, the size of the file.
api::MapDescription DescriptionOf(const map::Snapshot& map);

}  // namespace cairn::host

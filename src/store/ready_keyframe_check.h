// Whether the pages of keyframes of the map ready to be queried say what the tables say, for `verify`.
#pragma once

#include <span>

#include "base/status.h"
#include "store/checked_keyframe.h"
#include "store/map_assembly.h"
#include "store/sqlite.h"

namespace cairn::store {

// Within a read transaction, of a map whose rows are good; `keyframes` are all of them, ascending.
absl::Status CheckReadyKeyframes(Database* database, std::span<const CheckedKeyframe> keyframes,
                                 const FindingSink& sink);

}  // namespace cairn::store

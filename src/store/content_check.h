// Whether the rows of a map are good, each by itself and all together, for `verify`: every checksum, every reference,
// and whether the map ready to be queried says the same. One keyframe, or the points of a range of ids, are in memory
// at a time; of every keyframe a hundred bytes are, and of every id of a point one bit.
#pragma once

#include "base/status.h"
#include "store/finding_limit.h"
#include "store/map_assembly.h"
#include "store/offered_work.h"
#include "store/sqlite.h"

namespace cairn::store {

// Of a map for which CanGoByRows() (digest.h), within a read transaction. An error only if checking itself was not
// possible, or of the sink. Whoever helps with what is `shared` does so by the connection `beside`, which has a read
// transaction of its own; both null: there is nobody.
absl::Status CheckContentByRows(Database* database, const FindingSink& sink, OfferedWork* shared, Database* beside);

}  // namespace cairn::store

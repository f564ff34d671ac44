// Whether the write-ahead log beside a map belongs to it. SQLite replays whatever valid log lies beside a database:
// that of a killed run onto a backup copied over the map, too. A log is told by what its changes carry: every commit
// writes the row of table `map`, with the map's id, the revision, and the token of the writer that made it
// (docs/map-format.md, "The write-ahead log").
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "base/ids.h"
#include "base/status.h"
#include "store/sqlite.h"

namespace cairn::store {

// What the row of table `map` says, as far as it stands in one page of the file.
struct MapState {
  std::string map_id;
  Revision revision = 0;
  std::string log_token;           // of the writer that made this revision; empty: of a format before 4
  std::string previous_log_token;  // of the writer before
  std::int64_t schema_cookie = 0;  // SQLite's, of the database that the writer writes: a copy has another
};

// 32 random hex digits: the token of a writer.
std::string NewLogToken();

// From the bytes of that page; none if they are not such a page.
std::optional<MapState> ParseMapPage(Bytes page);

// From the file of a database as it is on disk, without its log.
absl::StatusOr<std::optional<MapState>> ReadMapState(Database* database);

// OK if there is no log at `path`-wal, or one that SQLite may replay onto the file at `path`; else fault kForeignLog.
// Nothing is changed. `writing`: the caller has the right to write the map, so that nobody else is at it.
absl::Status CheckLog(const std::string& path, bool writing = false);

// What SQLite will pass over in the log of the map at `path`, for a user: changes that came to their end, behind bytes
// that are not as they were written. Empty if there is nothing of that kind. Of a change that is the last one it cannot
// be known whether it was ever acknowledged.
std::string DamageOfLog(const std::string& path);
// The same before the map is opened to be written, by which SQLite does away with the log: a copy is kept beside it.
std::string KeepDamagedLog(const std::string& path);

}  // namespace cairn::store

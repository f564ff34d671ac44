// Finding out what a file is before it is used as a map, and bringing a new map file into being.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/status.h"
#include "store/map_reader.h"
#include "store/map_store.h"
#include "store/sqlite.h"

namespace cairn::store {

// Whether this is a Cairn map of a format that this software knows, by the file's header and SQLite's user_version. A
// header that contradicts the tables is damage.
absl::Status CheckIdentity(Database* database);

// Compares tables and indexes (or with `views`, views) with what the migrations make. Further ones are no harm, but for
// those of a later format than the header says.
absl::Status CheckSchema(Database* database, bool views, const FindingSink& sink);

// Whether they are known at once as those of the newest format, as of a map that was just made.
absl::StatusOr<bool> HasNewestObjects(Database* database);

// For reading, in the way that the file, its folder and a writer at work allow. `immutable_stamp` gets FileStamp() if
// the file is read on the promise that nobody changes it, else stays empty.
absl::StatusOr<std::unique_ptr<Database>> OpenForReading(const std::string& path, std::string* immutable_stamp);
// Tells versions of a file apart: changes whenever it is written or gets a write-ahead log.
std::string FileStamp(const std::string& path);

// What to tell of a map that was to replace the one at `path` and was left beside it by a killed writer; empty if there
// is none. `writing`: the caller holds the right to write.
std::string LeftoverNote(const std::string& path, bool writing);

// Pragmas of a writing connection.
absl::Status PrepareForWriting(Database* database, const WriteOptions& options);

// What a new map may be called, and how its features may be extracted.
absl::Status CheckNewInfo(const map::MapInfo& info);
// Whether maps can be written in the folder of `path`: not on a file system of a network.
absl::Status CheckFileSystem(const std::string& path);
// A file of several names (hard links) has as many logs and locks, and they do not know of each other.
absl::Status CheckOneName(const std::string& path);
// A copy of the database as it is now, at a path where there is nothing. A failure leaves nothing there.
// `check` is asked of the copy before that, and its error ends it; may be empty.
absl::Status CopyDatabase(Database* database, const std::string& path,
                          const std::function<absl::Status(Database*)>& check = {});

// Writes a whole new map file at `fresh`, without keyframes. A failure leaves nothing there.
absl::Status WriteMapAt(const std::string& fresh, const MapRow& row, absl::string_view vocabulary);
// Likewise beside `path`, and puts it there, in place of a file that may be there, in one step.
absl::Status WriteNewMap(const std::string& path, const map::MapInfo& info, absl::string_view vocabulary);
// Puts the map file at `fresh`, which nobody has open, in the place of the one at `path`, in one step.
absl::Status PutInPlace(const std::string& fresh, const std::string& path);

// Inserts or replaces the vocabulary; use inside a transaction.
absl::Status WriteVocabulary(Database* database, absl::string_view bytes);

}  // namespace cairn::store

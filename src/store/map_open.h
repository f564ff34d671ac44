// Finding out what a file is before it is used as a map, and bringing a new map file into being.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/status.h"
#include "store/map_file.h"
#include "store/map_reader.h"
#include "store/sqlite.h"

namespace cairn::store {

// The path with symbolic links resolved, as locks and SQLite's companion files go by the real name. Faults: kNotFound,
// kNotAMap (not a regular file, or empty), kIo.
absl::StatusOr<std::string> ResolveExisting(const std::string& path);
// Likewise for a file that need not exist, but whose folder must.
absl::StatusOr<std::string> ResolveNew(const std::string& path);

// Whether this is a Cairn map of a format that this software knows, by the file's header and SQLite's user_version.
absl::Status CheckIdentity(Database* database);

// Compares tables and indexes (and with `views`, views) with what the migrations make. Further ones are no harm.
absl::Status CheckSchema(Database* database, bool views, const FindingSink& sink);

// For reading, in the way that the file, its folder and a writer at work allow. `immutable_stamp` gets FileStamp() if
// the file is read on the promise that nobody changes it, else stays empty.
absl::StatusOr<std::unique_ptr<Database>> OpenForReading(const std::string& path, std::string* immutable_stamp);
// Tells versions of a file apart: changes whenever it is written or gets a write-ahead log.
std::string FileStamp(const std::string& path);

// Pragmas of a writing connection.
absl::Status PrepareForWriting(Database* database, const WriteOptions& options);

// Writes a whole new map file and puts it at `path`, in place of a file that may be there, in one step.
absl::Status WriteNewMap(const std::string& path, const map::MapInfo& info, absl::string_view vocabulary);

// Inserts or replaces the vocabulary; use inside a transaction.
absl::Status WriteVocabulary(Database* database, absl::string_view bytes);

}  // namespace cairn::store

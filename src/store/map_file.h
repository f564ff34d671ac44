// One map in one SQLite file (docs/map-format.md). What is committed stays, whatever happens to the process: there is
// no save step.
//
// One process writes a map at a time, any number read it meanwhile; a reader sees whole revisions only. Every error
// names the file and carries a Fault (store/fault.h). A MapFile may be used by one thread at a time; several may be
// open on one file.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "base/status.h"
#include "map/delta.h"
#include "map/snapshot.h"
#include "store/fault.h"

namespace cairn::store {

class Database;
class WriterLock;
class DeltaWriter;

// The format that this software writes, and the newest that it reads (SQLite's user_version).
int SupportedFormatVersion();

struct WriteOptions {
  // Wait for the disk after every commit, so that a power failure too loses at most the change in flight. Without it a
  // power failure may lose the last seconds; the map is good in either case, and a killed process never loses a commit.
  bool sync_every_commit = true;
  // Note in the log of changes when each was made. Off in deterministic runs.
  bool record_wall_clock = true;
};

struct CreateOptions {
  bool overwrite = false;             // replace a file that is there, in one step, once the new map is complete on disk
  absl::string_view vocabulary = {};  // serialised; stored with the map from the start (or later by PutVocabulary)
  WriteOptions write = {};
};

// Sizes, without loading the map.
struct MapSummary {
  int format_version = 0;
  Revision revision = 0;
  map::MapInfo info;
  std::int64_t cameras = 0;
  std::int64_t sessions = 0;
  std::int64_t keyframes = 0;
  std::int64_t points = 0;
  std::int64_t covisibility_edges = 0;
  std::int64_t file_bytes = 0;        // of the database, without what a writer has in its write-ahead log
  std::int64_t vocabulary_bytes = 0;  // of these
};

// One line of the log of changes; the newest kMaxLoggedChanges are kept.
struct LoggedChange {
  Revision revision = 0;
  std::string reason;
  std::int64_t committed_unix_ns = 0;  // 0: not recorded
  std::int64_t keyframes_put = 0;
  std::int64_t keyframes_removed = 0;
  std::int64_t points_put = 0;
  std::int64_t points_removed = 0;
};
inline constexpr int kMaxLoggedChanges = 1000;

// Something wrong with a map file.
struct Finding {
  std::string table;    // empty: the file as a whole
  std::int64_t id = 0;  // of the row; 0: the table as a whole
  std::string message;
};

class MapFile {
 public:
  // A new map at revision 0, open for writing. Faults: kExists, kReadOnly, kFull, kBusy; InvalidArgument if `info`
  // makes no sense. A failure leaves nothing behind, and the file that was there as it was.
  static absl::StatusOr<std::unique_ptr<MapFile>> Create(const std::string& path, const map::MapInfo& info,
                                                         const CreateOptions& options = {});

  // For writing; brings an older format up to date. Faults: all but kExists.
  static absl::StatusOr<std::unique_ptr<MapFile>> Open(const std::string& path, const WriteOptions& options = {});

  // For reading; also on a read-only medium. The content of the map is never changed (a write-ahead log left behind by
  // a killed writer may be folded into the file).
  static absl::StatusOr<std::unique_ptr<MapFile>> OpenReadOnly(const std::string& path);

  // Close(), errors ignored.
  ~MapFile();
  MapFile(const MapFile&) = delete;
  MapFile& operator=(const MapFile&) = delete;

  // Folds the write-ahead log into the file, so that the map is one file again (unless readers still hold it: then the
  // last of them does it), and gives up the writer's lock. Nothing else may be called afterwards.
  absl::Status Close();

  const std::string& path() const { return path_; }
  bool writable() const { return lock_ != nullptr; }

  // Exactly one transaction: after OK the change is in the file for good, after an error nothing of it is.
  // Errors: FailedPrecondition if delta.base is not the file's revision or the file is open for reading,
  // InvalidArgument if the delta contradicts itself or the map, kFull, kReadOnly, kIo, kDamaged.
  absl::Status Commit(const map::Delta& delta);

  // The newest revision, with every checksum and every reference checked. kDamaged names the table and row at fault.
  absl::StatusOr<std::shared_ptr<const map::Snapshot>> LoadSnapshot();

  // Stores the vocabulary that MapInfo::vocabulary_hash names. FailedPrecondition if another one is stored and
  // keyframes exist.
  absl::Status PutVocabulary(absl::string_view bytes);
  // As it was put. NotFound (without a fault) if the map has none.
  absl::StatusOr<std::string> LoadVocabulary();

  // Cheap: to see whether a writer has moved on.
  absl::StatusOr<Revision> ReadRevision();
  absl::StatusOr<MapSummary> ReadSummary();
  // The newest first, at most `max_count`.
  absl::StatusOr<std::vector<LoggedChange>> ReadChanges(int max_count = kMaxLoggedChanges);

  // Everything there is to check: SQLite's own structures, foreign keys, every checksum, the consistency of the map. No
  // findings: the map is good. An error only if checking itself was not possible.
  absl::StatusOr<std::vector<Finding>> Verify();

  // ContentDigest (store/digest.h) of the newest revision.
  absl::StatusOr<std::string> ContentDigest();

  // Gives room that removed keyframes and points left back to the file system. Needs as much free disk as the map has
  // bytes.
  absl::Status Compact();

 private:
  // Open() once the right to write is there; `resolved` as by ResolveExisting.
  static absl::StatusOr<std::unique_ptr<MapFile>> OpenLocked(const std::string& path, const std::string& resolved,
                                                             std::unique_ptr<WriterLock> lock,
                                                             const WriteOptions& options);
  MapFile(std::string path, std::unique_ptr<Database> database, std::unique_ptr<WriterLock> lock,
          const WriteOptions& options);
  absl::Status Annotated(const absl::Status& status) const;
  absl::Status CheckUnchanged() const;
  absl::Status RequireWritable() const;

  std::string path_;
  std::unique_ptr<WriterLock> lock_;  // null: read-only
  std::unique_ptr<Database> database_;
  std::unique_ptr<DeltaWriter> writer_;
  WriteOptions options_;
  std::string immutable_stamp_;  // not empty: opened on the promise that nobody writes; this tells whether that held
};

}  // namespace cairn::store

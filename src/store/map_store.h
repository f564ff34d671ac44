// Where one map is kept: what is committed stays, whatever happens to the process; there is no save step. The interface
// is what all others see; today there is one implementation, a file of SQLite's (sqlite_map_store.h). Nothing outside
// of this folder assumes a file: a map has a URI.
//
// One process writes a map at a time, any number read it meanwhile; a reader sees whole revisions only. Every error
// names the map and carries a Fault (store/fault.h). A store may be used by one thread at a time; several may be open
// on one map.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "base/shared_bytes.h"
#include "base/status.h"
#include "map/changed_rows.h"
#include "map/delta.h"
#include "map/history.h"
#include "map/overview.h"
#include "map/snapshot.h"
#include "store/fault.h"

namespace cairn::store {

// The format that this software writes, and the newest that it reads (docs/map-format.md).
int SupportedFormatVersion();

struct WriteOptions {
  // Wait for the disk after every commit, so that a power failure too loses at most the change in flight. Without it a
  // power failure may lose the last seconds; the map is good in either case, and a killed process never loses a commit.
  bool sync_every_commit = true;
  // Note in the log of changes when each was made. Off in deterministic runs.
  bool record_wall_clock = true;
  // Keep the map ready to be queried (LoadReady): what it takes is written when the map is closed, a tenth of the map.
  bool ready = true;
};

struct CreateOptions {
  bool overwrite = false;       // replace a map that is there, in one step, once the new one is complete
  std::string vocabulary = {};  // serialised; stored with the map from the start (or later by PutVocabulary)
  // The map is there at once, without keyframes.
  bool at_once = false;
  // The map is at its name only once Close() has said OK, with everything that was committed; until then it is beside,
  // as one that replaces another, and if the store goes without Close(), nothing of it stays.
  bool whole = false;
  WriteOptions write = {};
};

enum class OpenMode {
  kRead,   // also on a read-only medium; the content of the map is never changed
  kWrite,  // brings an older format up to date, and makes a backup before
};

struct LoadOptions {
  // Features of keyframes, most of a map, come from the store when somebody looks at them, and so many bytes of them
  // are kept (map/feature_cache.h). None: all are in memory.
  std::optional<std::size_t> feature_budget_bytes = std::nullopt;
  // Is given the words of each keyframe on the way, ascending; an error ends the loading. May be empty.
  std::function<absl::Status(KeyframeId keyframe, const std::vector<std::uint32_t>& words)> words = {};
};

// A map that need not be loaded to be asked (docs/map-format.md, "Ready pages").
struct ReadyMap {
  // Its keyframes and points come from the store when somebody looks at them. Whatever cannot be read then is told to
  // its feature_cache(): of the fault kBusy if it was written anew since, so that the map is to be loaded again; else
  // the map must be loaded as a whole.
  std::shared_ptr<const map::Snapshot> map;
  // What has happened since that revision; none: nothing.
  std::optional<map::Delta> since;
};

struct ReadyOptions {
  std::size_t feature_budget_bytes = 0;  // as of LoadOptions
  // Is given the place index, part by part: the keyframes of a place::PostingSegment (none: that have left the map),
  // and its bytes. After an error the map is not ready.
  std::function<absl::Status(std::span<const KeyframeId> keyframes, SharedBytes packed)> segment = {};
};

// Sizes, without loading the map.
using MapSummary = map::StoredSummary;

using map::ChangeQuery;
using map::Finding;
using map::kMaxLoggedChanges;
using map::LoggedChange;

// How far back MapStore::ReadDelta() reaches: what was removed in the newest so many revisions is remembered.
inline constexpr Revision kMaxDeltaRevisions = 1000;

class MapStore {
 public:
  // Close(), errors ignored.
  virtual ~MapStore() = default;
  MapStore(const MapStore&) = delete;
  MapStore& operator=(const MapStore&) = delete;

  // Gives up the right to write, and leaves the map as tidy as it can be. The error if the map is not where it was
  // opened any more. Nothing else may be called afterwards.
  virtual absl::Status Close() = 0;

  virtual const std::string& uri() const = 0;
  virtual bool writable() const = 0;
  // False: a new map of which nothing is kept yet (CreateMapStore).
  virtual bool exists() const = 0;
  // What a user should be told of the state in which it was found, or of what opening did: one sentence each.
  virtual const std::vector<std::string>& notes() const = 0;

  // Exactly one transaction: after OK the change is in the map for good, after an error nothing of it is (but for kIo:
  // what a disk kept that failed to say so is found when the map is opened next, as a whole or not at all). The delta
  // must be one that Snapshot::Apply() takes: nothing is checked here but what would make the rows contradict each
  // other. Errors: FailedPrecondition if delta.base is not the map's revision (so that a change is never made twice) or
  // the map is open for reading, kFull, kReadOnly, kIo, kDamaged, kMoved.
  virtual absl::Status Commit(const map::Delta& delta) = 0;

  // The newest revision, with every checksum and every reference checked. kDamaged names the table and row at fault.
  virtual absl::StatusOr<std::shared_ptr<const map::Snapshot>> LoadSnapshot(const LoadOptions& options = {}) = 0;

  // The newest revision at a cost in proportion to what has changed since a writer closed the map. Nothing if it is not
  // kept ready, if too much has changed since, or if what is kept is damaged: LoadSnapshot() tells.
  virtual absl::StatusOr<std::optional<ReadyMap>> LoadReady(const ReadyOptions& options) = 0;

  // Stores the vocabulary that MapInfo::vocabulary_hash names. FailedPrecondition if another one is stored and
  // keyframes exist.
  virtual absl::Status PutVocabulary(absl::string_view bytes) = 0;
  // As it was put. NotFound (without a fault) if the map has none.
  virtual absl::StatusOr<std::string> LoadVocabulary() = 0;

  // Cheap: to see whether a writer has moved on. kMoved, as of ReadDelta, if the map was removed or replaced by another
  // one since it was opened: open it again.
  virtual absl::StatusOr<Revision> ReadRevision() = 0;
  // All changes since `base`, a revision of this map, as one: base.Apply() makes it the newest revision, equal to the
  // bit to what LoadSnapshot() gives. Reads as much as changed; what did not is shared with `base`. With
  // `num_changes` 0 if nothing has happened. Nothing if `base` is too old (kMaxDeltaRevisions), not of this map, or the
  // map is of a format before 4: load it anew. Errors as of LoadSnapshot.
  virtual absl::StatusOr<std::optional<map::Delta>> ReadDelta(const map::Snapshot& base) = 0;
  // Which rows changed since a revision of this map, for who has the newest one in memory and knows of somebody with
  // the older one. Nothing as of ReadDelta().
  virtual absl::StatusOr<std::optional<map::ChangedRows>> ReadChangedRows(Revision since) = 0;
  virtual absl::StatusOr<MapSummary> ReadSummary() = 0;
  // The newest first.
  virtual absl::StatusOr<std::vector<LoggedChange>> ReadChanges(const ChangeQuery& query = {}) = 0;

  // Everything there is to check: the store's own structures, every reference, every checksum, the consistency of the
  // map. No findings: the map is good. An error only if checking itself was not possible.
  virtual absl::StatusOr<std::vector<Finding>> Verify() = 0;

  // ContentDigest (store/digest.h) of the newest revision.
  virtual absl::StatusOr<std::string> ContentDigest() = 0;

  // Writes the newest revision to a map of its own, while others may go on writing this one. kExists if there is one.
  virtual absl::Status CopyTo(const std::string& uri) = 0;
  // The same, if that is a good map (Verify(), StatusOf()); else nothing is there.
  virtual absl::Status CopySound(const std::string& uri) = 0;

  // Gives room that removed keyframes and points left back. Needs as much free disk as the map has bytes.
  virtual absl::Status Compact() = 0;

 protected:
  MapStore() = default;
};

// OK without findings; else of fault kDamaged, with the first of them and what to do.
absl::Status StatusOf(const std::vector<Finding>& findings);

// The map at `uri`: the path of a file, for now. Faults: all but kExists.
absl::StatusOr<std::unique_ptr<MapStore>> OpenMapStore(const std::string& uri, OpenMode mode,
                                                       const WriteOptions& options = {});

// Gives a map another name, in one step; what a killed writer left in its log goes along. kExists if there is a map of
// that name, kBusy if somebody writes it, kForeignLog as of OpenMapStore; FailedPrecondition for a map that is a link
// to another. Readers that have it open notice (kMoved) when they look next.
absl::Status MoveMapStore(const std::string& from_uri, const std::string& to_uri);

// A new map, open for writing. It comes into being with the first keyframe that is committed (unless it is to be there
// at once): whoever commits none leaves nothing behind. A map that is to be overwritten stays until Close(), which
// replaces it in one step; until then the new one is complete up to its last commit beside it, named in
// docs/map-format.md, and after a kill both are there. Faults: kExists, kNotAMap (what is to be overwritten is
// something else), kReadOnly, kFull, kBusy; InvalidArgument if `info` or the name makes no sense. These are found now,
// not when the first keyframe comes.
absl::StatusOr<std::unique_ptr<MapStore>> CreateMapStore(const std::string& uri, const map::MapInfo& info,
                                                         CreateOptions options = {});

}  // namespace cairn::store

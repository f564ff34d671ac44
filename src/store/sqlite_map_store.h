// One map in one SQLite file (docs/map-format.md).
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "store/file_paths.h"
#include "store/map_store.h"

namespace cairn::store {

class Database;
class WriterLock;
class DeltaWriter;

class SqliteMapStore : public MapStore {
 public:
  // A new map at revision 0, there at once. A failure leaves nothing behind, and the file that was there as it was.
  static absl::StatusOr<std::unique_ptr<SqliteMapStore>> Create(const std::string& path, const map::MapInfo& info,
                                                                const CreateOptions& options = {});
  static absl::StatusOr<std::unique_ptr<SqliteMapStore>> Open(const std::string& path,
                                                              const WriteOptions& options = {});
  // A write-ahead log left behind by a killed writer may be folded into the file.
  static absl::StatusOr<std::unique_ptr<SqliteMapStore>> OpenReadOnly(const std::string& path);

  ~SqliteMapStore() override;

  // Folds the write-ahead log into the file, so that the map is one file again (unless readers still hold it: then the
  // last of them does it). If the file was removed meanwhile, its content is saved beside where it was, as
  // `<path>.rescued`; the error (kMoved) says where it is.
  absl::Status Close() override;

  const std::string& uri() const override { return path_; }
  bool writable() const override { return writer_ != nullptr; }
  bool exists() const override { return true; }
  const std::vector<std::string>& notes() const override { return notes_; }
  absl::Status Commit(const map::Delta& delta) override;
  absl::StatusOr<std::shared_ptr<const map::Snapshot>> LoadSnapshot(const LoadOptions& options = {}) override;
  absl::StatusOr<std::optional<ReadyMap>> LoadReady(const ReadyOptions& options) override;
  absl::Status PutVocabulary(absl::string_view bytes) override;
  absl::StatusOr<std::string> LoadVocabulary() override;
  absl::StatusOr<Revision> ReadRevision() override;
  absl::StatusOr<std::optional<map::Delta>> ReadDelta(const map::Snapshot& base) override;
  absl::StatusOr<std::optional<map::ChangedRows>> ReadChangedRows(Revision since) override;
  absl::StatusOr<MapSummary> ReadSummary() override;
  absl::StatusOr<std::vector<LoggedChange>> ReadChanges(const ChangeQuery& query = {}) override;
  absl::StatusOr<std::vector<Finding>> Verify() override;
  absl::StatusOr<std::string> ContentDigest() override;
  absl::Status CopySound(const std::string& path) override;
  absl::Status CopyTo(const std::string& path) override;
  absl::Status Compact() override;

 private:
  absl::Status Copy(const std::string& path, const std::function<absl::Status(Database*)>& check);
  friend class NewSqliteMap;

  // Open() once the right to write is there, which is kept in `lock` (null: somebody else keeps it); `resolved` as by
  // ResolveExisting.
  static absl::StatusOr<std::unique_ptr<SqliteMapStore>> OpenLocked(const std::string& path,
                                                                    const std::string& resolved,
                                                                    std::unique_ptr<WriterLock> lock,
                                                                    const WriteOptions& options);
  SqliteMapStore(std::string path, std::string resolved, std::unique_ptr<Database> database, FileIdentity identity);
  absl::Status Annotated(const absl::Status& status) const;
  absl::Status CheckUnchanged() const;
  absl::Status RequireWritable() const;
  // Fault kMoved unless the file and its log are where they were, and the file has the content that it had.
  absl::Status CheckInPlace();
  // For readers: fault kMoved if there is another file, or none, where it was opened.
  absl::Status CheckStillThere() const;
  // kMoved as well if the file has been written by somebody who is no Cairn, as cp onto it: SQLite would go on with
  // pages that it read before. Costs a look at the file's time, and an opening where that has changed.
  absl::Status CheckNotWrittenOver();
  // Whether the file on disk is the one of this writer, and not one that was copied over it.
  bool HasOwnContent();
  // What Close() says, and does, if they are not; the log is folded already.
  absl::Status Rescue(const absl::Status& moved);
  std::string RescuedPath() const;
  // `ready`: what readers are better off with is brought up to date, too, which takes its time.
  absl::Status CloseWriting(bool ready);
  // Brings the ready pages to the newest revision, if anything has changed.
  absl::Status RefreshReady();
  void NoteLeftovers();
  void NoteLogDamage(const std::string& damage);

  std::string path_;      // as the caller named it
  std::string resolved_;  // as locks and SQLite know it
  std::unique_ptr<WriterLock> lock_;
  std::unique_ptr<Database> database_;
  std::unique_ptr<DeltaWriter> writer_;  // null: read-only
  WriteOptions options_;
  FileIdentity identity_;
  std::string log_token_;  // of a writer, see write_ahead_log.h
  // The one before, while a reader at work kept the own one from getting into the file.
  std::string previous_log_token_;
  FileIdentity log_identity_;  // of a writer
  // Of a reader: the map that was opened, and the stamp of the file when it was known to be that.
  std::string map_id_;
  std::string known_stamp_;
  std::string immutable_stamp_;  // not empty: opened on the promise that nobody writes; this tells whether that held
  std::string log_damage_;       // write_ahead_log.h, DamageOfLog
  std::vector<std::string> notes_;
};

}  // namespace cairn::store

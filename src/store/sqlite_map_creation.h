// A map that comes into being with its first keyframe, or, if that was asked for, replaces another one or is there at
// all when it is closed: store::CreateMapStore for files.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "store/sqlite_map_store.h"

namespace cairn::store {

class NewSqliteMap : public MapStore {
 public:
  static absl::StatusOr<std::unique_ptr<MapStore>> Create(const std::string& path, const map::MapInfo& info,
                                                          CreateOptions options);
  ~NewSqliteMap() override;

  absl::Status Close() override;
  const std::string& uri() const override { return path_; }
  bool writable() const override { return true; }
  bool exists() const override { return file_ != nullptr; }
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
  absl::Status CopyTo(const std::string& path) override;
  absl::Status CopySound(const std::string& path) override;
  absl::Status Compact() override;

 private:
  NewSqliteMap(std::string path, std::string resolved, const map::MapInfo& info, CreateOptions options);
  absl::Status LockReplaced();
  absl::Status MakeFile();
  // Whether the file is made beside its name, and put there by Close().
  bool IsBeside() const { return replaces_ || options_.whole; }
  absl::Status PutInPlaceOfOld();
  void RemoveFresh();
  absl::Status RequireFile() const;

  std::string path_;
  std::string resolved_;
  CreateOptions options_;
  std::unique_ptr<WriterLock> lock_;  // of `resolved_`, from the start to the end
  bool replaces_ = false;
  FileIdentity replaced_;                         // the file that is to be replaced
  std::vector<map::Delta> waiting_;               // for the file
  std::shared_ptr<const map::Snapshot> current_;  // until there is a file
  std::unique_ptr<SqliteMapStore> file_;
  std::vector<std::string> notes_;
};

}  // namespace cairn::store

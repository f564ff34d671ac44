#include "store/sqlite_map_creation.h"

#include <unistd.h>

#include <utility>

#include "store/digest.h"
#include "store/map_open.h"
#include "store/sqlite.h"
#include "store/writer_lock.h"

namespace cairn::store {

NewSqliteMap::NewSqliteMap(std::string path, std::string resolved, const map::MapInfo& info, CreateOptions options)
    : path_(std::move(path)),
      resolved_(std::move(resolved)),
      options_(std::move(options)),
      current_(map::Snapshot::Empty(info)) {}

NewSqliteMap::~NewSqliteMap() {
  if (options_.whole && file_) {
    file_->Close().IgnoreError();
    file_.reset();
    RemoveFresh();
  }
  Close().IgnoreError();
}

absl::StatusOr<std::unique_ptr<MapStore>> NewSqliteMap::Create(const std::string& path, const map::MapInfo& info,
                                                               CreateOptions options) {
  auto created = [&]() -> absl::StatusOr<std::unique_ptr<MapStore>> {
    CAIRN_RETURN_IF_ERROR(CheckNewInfo(info));
    CAIRN_ASSIGN_OR_RETURN(std::string resolved, ResolveNew(path));
    CAIRN_RETURN_IF_ERROR(CheckNoCompanion(resolved));
    CAIRN_RETURN_IF_ERROR(CheckFileSystem(resolved));
    std::unique_ptr<NewSqliteMap> map(new NewSqliteMap(path, std::move(resolved), info, std::move(options)));
    if (!map->options_.overwrite && access(map->resolved_.c_str(), F_OK) == 0) {
      return MakeFault(
          Fault::kExists,
          "exists already: choose another name, extend it (--extend), or ask to overwrite it (--overwrite)");
    }
    CAIRN_ASSIGN_OR_RETURN(map->lock_, WriterLock::Acquire(map->resolved_));
    CAIRN_RETURN_IF_ERROR(map->LockReplaced());
    const std::string fresh = absl::StrCat(map->resolved_, kNewSuffix);
    if (HasContent(fresh)) {
      map->notes_.push_back(
          absl::StrCat(fresh, ", which a killed writer left, will be removed when the first keyframe is mapped"));
    }
    return map;
  }();
  if (!created.ok()) return Annotate(created.status(), absl::StrCat("creating map ", path));
  return created;
}

absl::Status NewSqliteMap::LockReplaced() {
  if (access(resolved_.c_str(), F_OK) != 0) return absl::OkStatus();
  replaces_ = true;
  // Only a map is overwritten, or an empty file.
  const absl::Status opened = SqliteMapStore::OpenReadOnly(resolved_).status();
  if (FaultOf(opened) == Fault::kNotAMap && HasContent(resolved_)) {
    return absl::FailedPreconditionError(
        "is not a Cairn map and is not overwritten: choose another name, or delete it first");
  }
  CAIRN_ASSIGN_OR_RETURN(replaced_, FileIdentity::Of(resolved_));
  return absl::OkStatus();
}

absl::Status NewSqliteMap::MakeFile() {
  if (!replaces_ && access(resolved_.c_str(), F_OK) == 0) {
    return MakeFault(Fault::kExists, "another file was put in its place meanwhile");
  }
  const std::string fresh = absl::StrCat(resolved_, kNewSuffix);
  const std::string& at = IsBeside() ? fresh : resolved_;
  const auto remove = [&at] {
    unlink(at.c_str());
    RemoveCompanions(at);
  };
  if (IsBeside()) {
    MapRow row;
    row.info = current_->info();
    CAIRN_RETURN_IF_ERROR(WriteMapAt(fresh, row, options_.vocabulary));
  } else {
    CAIRN_RETURN_IF_ERROR(WriteNewMap(resolved_, current_->info(), options_.vocabulary));
  }
  auto file = SqliteMapStore::OpenLocked(path_, at, nullptr, options_.write);
  absl::Status status = file.status();
  for (const map::Delta& delta : waiting_) {
    if (status.ok()) status = (*file)->Commit(delta);
  }
  if (!status.ok()) {
    if (file.ok()) file->reset();
    remove();
    return status;
  }
  file_ = *std::move(file);
  waiting_.clear();
  options_.vocabulary.clear();
  current_.reset();
  return absl::OkStatus();
}

absl::Status NewSqliteMap::Commit(const map::Delta& delta) {
  if (!file_ && delta.keyframes.empty()) {
    CAIRN_ASSIGN_OR_RETURN(current_, current_->Apply(delta));
    waiting_.push_back(delta);
    return absl::OkStatus();
  }
  if (!file_) CAIRN_RETURN_IF_ERROR(Annotate(MakeFile(), absl::StrCat("creating map ", path_)));
  return file_->Commit(delta);
}

absl::Status NewSqliteMap::Close() {
  absl::Status status;
  if (file_) {
    status = file_->Close();
    file_.reset();
    if (status.ok() && IsBeside()) {
      status = Annotate(PutInPlaceOfOld(), absl::StrCat("map ", path_));
    } else if (options_.whole) {
      RemoveFresh();
    }
  }
  lock_.reset();
  return status;
}

void NewSqliteMap::RemoveFresh() {
  const std::string fresh = absl::StrCat(resolved_, kNewSuffix);
  unlink(fresh.c_str());
  RemoveCompanions(fresh);
}

absl::Status NewSqliteMap::PutInPlaceOfOld() {
  const std::string fresh = absl::StrCat(resolved_, kNewSuffix);
  const bool vacant = access(resolved_.c_str(), F_OK) != 0;
  if (!vacant && !replaced_.IsAt(resolved_)) {
    return MakeFault(Fault::kMoved, absl::StrCat("another file was put in its place while the new map was made, and is "
                                                 "not overwritten: the new map is complete in ",
                                                 fresh));
  }
  return Annotate(PutInPlace(fresh, resolved_), absl::StrCat("the new map is complete in ", fresh));
}

absl::Status NewSqliteMap::RequireFile() const {
  if (file_) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrCat("map ", path_, " does not exist yet: it has no keyframe"));
}

absl::StatusOr<std::shared_ptr<const map::Snapshot>> NewSqliteMap::LoadSnapshot(const LoadOptions& options) {
  if (!file_) return current_;
  return file_->LoadSnapshot(options);
}

absl::StatusOr<std::optional<ReadyMap>> NewSqliteMap::LoadReady(const ReadyOptions& options) {
  if (!file_) return std::nullopt;
  return file_->LoadReady(options);
}

absl::Status NewSqliteMap::PutVocabulary(absl::string_view bytes) {
  if (file_) return file_->PutVocabulary(bytes);
  options_.vocabulary = std::string(bytes);
  return absl::OkStatus();
}

absl::StatusOr<std::string> NewSqliteMap::LoadVocabulary() {
  if (file_) return file_->LoadVocabulary();
  if (options_.vocabulary.empty()) return absl::NotFoundError(absl::StrCat("map ", path_, " holds no vocabulary"));
  return options_.vocabulary;
}

absl::StatusOr<Revision> NewSqliteMap::ReadRevision() {
  if (!file_) return current_->revision();
  return file_->ReadRevision();
}

absl::StatusOr<std::optional<map::Delta>> NewSqliteMap::ReadDelta(const map::Snapshot& base) {
  CAIRN_RETURN_IF_ERROR(RequireFile());
  return file_->ReadDelta(base);
}

absl::StatusOr<std::optional<map::ChangedRows>> NewSqliteMap::ReadChangedRows(Revision since) {
  CAIRN_RETURN_IF_ERROR(RequireFile());
  return file_->ReadChangedRows(since);
}

absl::StatusOr<MapSummary> NewSqliteMap::ReadSummary() {
  CAIRN_RETURN_IF_ERROR(RequireFile());
  return file_->ReadSummary();
}

absl::StatusOr<std::vector<LoggedChange>> NewSqliteMap::ReadChanges(const ChangeQuery& query) {
  CAIRN_RETURN_IF_ERROR(RequireFile());
  return file_->ReadChanges(query);
}

absl::StatusOr<std::vector<Finding>> NewSqliteMap::Verify() {
  CAIRN_RETURN_IF_ERROR(RequireFile());
  return file_->Verify();
}

absl::StatusOr<std::string> NewSqliteMap::ContentDigest() {
  if (!file_) return store::ContentDigest(*current_);
  return file_->ContentDigest();
}

absl::Status NewSqliteMap::CopyTo(const std::string& path) {
  CAIRN_RETURN_IF_ERROR(RequireFile());
  return file_->CopyTo(path);
}

absl::Status NewSqliteMap::CopySound(const std::string& path) {
  CAIRN_RETURN_IF_ERROR(RequireFile());
  return file_->CopySound(path);
}

absl::Status NewSqliteMap::Compact() {
  CAIRN_RETURN_IF_ERROR(RequireFile());
  return file_->Compact();
}

}  // namespace cairn::store

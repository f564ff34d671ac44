#include "engine/map_writer.h"

#include <filesystem>
#include <utility>

#include "base/status.h"
#include "store/fault.h"

namespace cairn::engine {
namespace {

// Only a map is overwritten, or an empty file, and only while nobody writes it.
absl::StatusOr<std::unique_ptr<store::WriterLock>> LockReplaced(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) {
    return absl::FailedPreconditionError(absl::StrCat(path, " is not a file: choose another name for the map"));
  }
  const absl::Status opened = store::MapFile::OpenReadOnly(path).status();
  if (store::FaultOf(opened) == store::Fault::kNotAMap && std::filesystem::file_size(path, error) > 0) {
    return absl::FailedPreconditionError(
        absl::StrCat(path, " is not a Cairn map and is not overwritten: choose another name, or delete it first"));
  }
  auto lock =
      store::WriterLock::Acquire(std::filesystem::weakly_canonical(std::filesystem::absolute(path), error).string());
  if (!lock.ok()) return Annotate(lock.status(), absl::StrCat("overwriting map ", path));
  return lock;
}

}  // namespace

absl::StatusOr<std::unique_ptr<MapWriter>> MapWriter::Create(const std::string& path, map::MapInfo info,
                                                             CreateOptions options) {
  std::error_code error;
  if (!options.overwrite && std::filesystem::exists(path, error)) {
    return absl::AlreadyExistsError(
        absl::StrCat(path, " exists already: choose another name, or ask to overwrite it (--overwrite)"));
  }
  std::unique_ptr<MapWriter> writer(new MapWriter);
  if (std::filesystem::exists(path, error)) {
    CAIRN_ASSIGN_OR_RETURN(writer->replaced_, LockReplaced(path));
  }
  writer->path_ = path;
  writer->options_ = std::move(options);
  writer->initial_ = map::Snapshot::Empty(std::move(info));
  writer->current_ = writer->initial_;
  return writer;
}

absl::StatusOr<std::unique_ptr<MapWriter>> MapWriter::Open(const std::string& path) {
  std::unique_ptr<MapWriter> writer(new MapWriter);
  writer->path_ = path;
  CAIRN_ASSIGN_OR_RETURN(writer->file_, store::MapFile::Open(path));
  CAIRN_ASSIGN_OR_RETURN(writer->current_, writer->file_->LoadSnapshot());
  return writer;
}

absl::Status MapWriter::CreateFile() {
  std::error_code error;
  const bool replaces = options_.overwrite && std::filesystem::exists(path_, error);
  if (replaces && !replaced_) {
    CAIRN_ASSIGN_OR_RETURN(replaced_, LockReplaced(path_));
  }
  file_path_ = replaces ? path_ + ".new" : path_;
  store::CreateOptions create;
  create.overwrite = options_.overwrite;
  create.vocabulary = options_.vocabulary;
  create.write.record_wall_clock = options_.record_wall_clock;
  CAIRN_ASSIGN_OR_RETURN(auto file, store::MapFile::Create(file_path_, initial_->info(), create));
  for (const map::Delta& delta : waiting_) CAIRN_RETURN_IF_ERROR(file->Commit(delta));
  waiting_.clear();
  options_.vocabulary.clear();
  initial_.reset();
  file_ = std::move(file);
  return absl::OkStatus();
}

absl::StatusOr<std::shared_ptr<const map::Snapshot>> MapWriter::Commit(map::Delta delta) {
  CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<const map::Snapshot> next, Current()->Apply(delta));
  CAIRN_RETURN_IF_ERROR(Flush());
  if (!file_ && delta.keyframes.empty()) {
    waiting_.push_back(std::move(delta));
  } else {
    if (!file_) CAIRN_RETURN_IF_ERROR(CreateFile());
    if (thread_.joinable()) {
      std::lock_guard lock(store_mutex_);
      change_ = std::move(delta);
      store_changed_.notify_all();
    } else {
      CAIRN_RETURN_IF_ERROR(file_->Commit(delta));
    }
  }
  std::lock_guard lock(mutex_);
  current_ = next;
  return next;
}

void MapWriter::StoreInBackground() {
  if (!thread_.joinable()) thread_ = std::thread([this] { StoreChanges(); });
}

void MapWriter::StoreChanges() {
  std::unique_lock lock(store_mutex_);
  for (;;) {
    store_changed_.wait(lock, [&] { return stop_ || change_; });
    if (!change_) return;
    lock.unlock();
    absl::Status stored = file_->Commit(*change_);
    lock.lock();
    stored_.Update(stored);
    change_.reset();
    store_changed_.notify_all();
  }
}

absl::Status MapWriter::Flush() {
  std::unique_lock lock(store_mutex_);
  store_changed_.wait(lock, [&] { return !change_; });
  return stored_;
}

MapWriter::~MapWriter() {
  if (!thread_.joinable()) return;
  {
    std::lock_guard lock(store_mutex_);
    stop_ = true;
    store_changed_.notify_all();
  }
  thread_.join();
}

absl::Status MapWriter::Close() {
  if (!file_) return absl::OkStatus();
  CAIRN_RETURN_IF_ERROR(Flush());
  CAIRN_RETURN_IF_ERROR(file_->Close());
  if (file_path_.empty() || file_path_ == path_) return absl::OkStatus();
  return Replace();
}

absl::Status MapWriter::Replace() {
  // A write-ahead log that a killed writer left would be taken for the new map's: fold it into the old map first.
  std::error_code error;
  if (std::filesystem::exists(path_ + "-wal", error)) {
    replaced_.reset();
    absl::StatusOr<std::unique_ptr<store::MapFile>> old = store::MapFile::Open(path_);
    if (old.ok()) CAIRN_RETURN_IF_ERROR((*old)->Close());
    std::filesystem::remove(path_ + "-wal", error);
    std::filesystem::remove(path_ + "-shm", error);
  }
  std::filesystem::rename(file_path_, path_, error);
  if (error) {
    return store::MakeFault(store::Fault::kIo, absl::StrCat("cannot replace ", path_, " (", error.message(),
                                                            "): the new map is complete in ", file_path_));
  }
  return absl::OkStatus();
}

std::shared_ptr<const map::Snapshot> MapWriter::Current() const {
  std::lock_guard lock(mutex_);
  return current_;
}

}  // namespace cairn::engine

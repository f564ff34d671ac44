#include "engine/map_writer.h"

#include <utility>

#include "base/status.h"

namespace cairn::engine {

absl::StatusOr<std::unique_ptr<MapWriter>> MapWriter::Create(const std::string& path, map::MapInfo info,
                                                             CreateOptions options) {
  store::CreateOptions create;
  create.overwrite = options.overwrite;
  create.vocabulary = std::move(options.vocabulary);
  create.write.record_wall_clock = options.record_wall_clock;
  std::unique_ptr<MapWriter> writer(new MapWriter);
  writer->path_ = path;
  CAIRN_ASSIGN_OR_RETURN(writer->store_, store::CreateMapStore(path, info, std::move(create)));
  writer->current_ = map::Snapshot::Empty(std::move(info));
  return writer;
}

absl::StatusOr<std::unique_ptr<MapWriter>> MapWriter::Open(const std::string& path) {
  std::unique_ptr<MapWriter> writer(new MapWriter);
  writer->path_ = path;
  CAIRN_ASSIGN_OR_RETURN(writer->store_, store::OpenMapStore(path, store::OpenMode::kWrite));
  CAIRN_ASSIGN_OR_RETURN(writer->current_, writer->store_->LoadSnapshot());
  writer->has_keyframes_ = !writer->current_->keyframes().empty();
  return writer;
}

absl::StatusOr<std::shared_ptr<const map::Snapshot>> MapWriter::Commit(map::Delta delta) {
  CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<const map::Snapshot> next, Current()->Apply(delta));
  CAIRN_RETURN_IF_ERROR(Flush());
  // The first keyframe makes the file: whether that can be is told at once.
  const bool makes_file = !has_keyframes_ && !delta.keyframes.empty();
  if (thread_.joinable() && !makes_file) {
    std::lock_guard lock(store_mutex_);
    change_ = std::move(delta);
    store_changed_.notify_all();
  } else {
    CAIRN_RETURN_IF_ERROR(store_->Commit(delta));
    has_keyframes_ = has_keyframes_ || makes_file;
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
    absl::Status stored = store_->Commit(*change_);
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
  CAIRN_RETURN_IF_ERROR(Flush());
  return store_->Close();
}

std::shared_ptr<const map::Snapshot> MapWriter::Current() const {
  std::lock_guard lock(mutex_);
  return current_;
}

}  // namespace cairn::engine

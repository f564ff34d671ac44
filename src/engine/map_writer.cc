#include "engine/map_writer.h"

#include <filesystem>
#include <utility>

namespace cairn::engine {

absl::StatusOr<std::unique_ptr<MapWriter>> MapWriter::Create(const std::string& path, map::MapInfo info,
                                                             CreateOptions options) {
  std::error_code error;
  if (!options.overwrite && std::filesystem::exists(path, error)) {
    return absl::AlreadyExistsError(
        absl::StrCat(path, " exists already: choose another name, or ask to overwrite it (--overwrite)"));
  }
  std::unique_ptr<MapWriter> writer(new MapWriter);
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
  store::CreateOptions create;
  create.overwrite = options_.overwrite;
  create.vocabulary = options_.vocabulary;
  create.write.record_wall_clock = options_.record_wall_clock;
  CAIRN_ASSIGN_OR_RETURN(auto file, store::MapFile::Create(path_, initial_->info(), create));
  for (const map::Delta& delta : waiting_) CAIRN_RETURN_IF_ERROR(file->Commit(delta));
  waiting_.clear();
  options_.vocabulary.clear();
  initial_.reset();
  file_ = std::move(file);
  return absl::OkStatus();
}

absl::StatusOr<std::shared_ptr<const map::Snapshot>> MapWriter::Commit(const map::Delta& delta) {
  CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<const map::Snapshot> next, Current()->Apply(delta));
  if (!file_ && delta.keyframes.empty()) {
    waiting_.push_back(delta);
  } else {
    if (!file_) CAIRN_RETURN_IF_ERROR(CreateFile());
    CAIRN_RETURN_IF_ERROR(file_->Commit(delta));
  }
  std::lock_guard lock(mutex_);
  current_ = next;
  return next;
}

std::shared_ptr<const map::Snapshot> MapWriter::Current() const {
  std::lock_guard lock(mutex_);
  return current_;
}

}  // namespace cairn::engine

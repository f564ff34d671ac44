#include "client/map_reader.h"

#include <optional>
#include <utility>

namespace cairn::client {

absl::StatusOr<std::unique_ptr<MapReader>> MapReader::Open(const std::string& path) {
  auto reader = std::unique_ptr<MapReader>(new MapReader);
  CAIRN_ASSIGN_OR_RETURN(reader->file_, store::OpenMapStore(path, store::OpenMode::kRead));
  const absl::StatusOr<std::string> bytes = reader->file_->LoadVocabulary();
  if (absl::IsNotFound(bytes.status())) {
    return absl::FailedPreconditionError(
        absl::StrCat(path, ": the map has no vocabulary, so that no place can be found in it"));
  }
  CAIRN_RETURN_IF_ERROR(bytes.status());
  absl::StatusOr<place::Vocabulary> vocabulary = place::Vocabulary::Parse(*bytes);
  CAIRN_RETURN_IF_ERROR(Annotate(vocabulary.status(), absl::StrCat(path, ": vocabulary")));
  reader->vocabulary_ = std::make_shared<const place::Vocabulary>(*std::move(vocabulary));
  CAIRN_RETURN_IF_ERROR(reader->Load());
  return reader;
}

absl::Status MapReader::Load() {
  CAIRN_ASSIGN_OR_RETURN(auto snapshot, file_->LoadSnapshot());
  auto view = tracking::MapView::Create(std::move(snapshot), vocabulary_);
  CAIRN_RETURN_IF_ERROR(Annotate(view.status(), file_->uri()));
  view_ = *std::move(view);
  return absl::OkStatus();
}

absl::StatusOr<bool> MapReader::Refresh() {
  CAIRN_ASSIGN_OR_RETURN(const Revision newest, file_->ReadRevision());
  if (newest == view_->revision()) return false;
  CAIRN_ASSIGN_OR_RETURN(const std::optional<map::Delta> delta, file_->ReadDelta(view_->map()));
  if (!delta) {
    CAIRN_RETURN_IF_ERROR(Load());
    return true;
  }
  auto next = view_->After(*delta);
  CAIRN_RETURN_IF_ERROR(Annotate(next.status(), file_->uri()));
  view_ = *std::move(next);
  return true;
}

}  // namespace cairn::client

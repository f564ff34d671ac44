#include "client/map_reader.h"

#include <mutex>
#include <optional>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "health/map_vocabulary.h"
#include "place/vocabulary.h"

namespace cairn::client {

// What readers share. Thread-safe.
class MapReader::File {
 public:
  static absl::StatusOr<std::shared_ptr<File>> Open(const std::string& path, const MapReaderOptions& options) {
    auto opened = std::make_shared<File>();
    opened->options_ = options;
    CAIRN_ASSIGN_OR_RETURN(opened->file_, store::OpenMapStore(path, store::OpenMode::kRead));
    CAIRN_ASSIGN_OR_RETURN(health::MapVocabulary vocabulary, health::LoadVocabulary(*opened->file_));
    if (vocabulary.words == nullptr) {
      return absl::FailedPreconditionError(
          absl::StrCat(path, ": the map has no vocabulary, so that no place can be found in it"));
    }
    opened->vocabulary_ = std::move(vocabulary.words);
    const std::lock_guard lock(opened->mutex_);
    CAIRN_RETURN_IF_ERROR(opened->Load());
    return opened;
  }

  static absl::StatusOr<std::shared_ptr<File>> OpenFrom(const std::string& path,
                                                        std::shared_ptr<const tracking::MapView> known) {
    auto opened = std::make_shared<File>();
    CAIRN_ASSIGN_OR_RETURN(opened->file_, store::OpenMapStore(path, store::OpenMode::kRead));
    CAIRN_ASSIGN_OR_RETURN(const store::MapSummary summary, opened->file_->ReadSummary());
    if (known->places() == nullptr || summary.info.id != known->map().info().id ||
        summary.revision < known->revision()) {
      return Open(path, {});
    }
    // It is the view's, and lives as long.
    opened->vocabulary_ = std::shared_ptr<const place::Vocabulary>(known, &known->places()->vocabulary());
    {
      const std::lock_guard lock(opened->mutex_);
      opened->view_ = std::move(known);
    }
    CAIRN_RETURN_IF_ERROR(opened->Newest().status());
    return opened;
  }

  // The newest revision. Others that ask meanwhile wait, and find it read.
  absl::StatusOr<std::shared_ptr<const tracking::MapView>> Newest() {
    const std::lock_guard lock(mutex_);
    CAIRN_ASSIGN_OR_RETURN(const Revision newest, file_->ReadRevision());
    const auto& features = view_->map().feature_cache();  // null: the view came from who wrote the map
    if (features != nullptr && !features->status().ok()) {
      // What is kept ready is written anew now and then; it may be damaged where the map is not.
      may_be_ready_ = may_be_ready_ && store::FaultOf(features->status()) == store::Fault::kBusy;
      CAIRN_RETURN_IF_ERROR(Load());
      return view_;
    }
    ForgetBeyondBudget();
    if (newest == view_->revision()) return view_;
    CAIRN_ASSIGN_OR_RETURN(const std::optional<map::Delta> delta, file_->ReadDelta(view_->map()));
    if (!delta) {
      CAIRN_RETURN_IF_ERROR(Load());
      return view_;
    }
    auto next = view_->After(*delta);
    CAIRN_RETURN_IF_ERROR(Annotate(next.status(), file_->uri()));
    view_ = *std::move(next);
    return view_;
  }

  std::shared_ptr<const tracking::MapView> view() const {
    const std::lock_guard lock(mutex_);
    return view_;
  }

  absl::StatusOr<store::MapSummary> ReadSummary() {
    const std::lock_guard lock(mutex_);
    return file_->ReadSummary();
  }

 private:
  absl::Status Load() {
    if (may_be_ready_) {
      const std::shared_ptr<const tracking::MapView> ready = LoadReady();
      if (ready != nullptr) {
        view_ = ready;
        return absl::OkStatus();
      }
    }
    return LoadWhole();
  }

  // Null: the map must be loaded as a whole.
  std::shared_ptr<const tracking::MapView> LoadReady() {
    auto places = tracking::PlaceIndex::Builder::Create(vocabulary_);
    if (!places.ok()) return nullptr;
    store::ReadyOptions load;
    load.feature_budget_bytes = options_.feature_budget_bytes;
    load.segment = [&](std::span<const KeyframeId> keyframes, SharedBytes packed) {
      return places->AddSegment(keyframes, std::move(packed));
    };
    const auto ready = file_->LoadReady(load);
    if (!ready.ok() || !*ready) return nullptr;
    auto view = ViewOf((*ready)->map, *std::move(places));
    if (view.ok() && (*ready)->since) view = (*view)->After(*(*ready)->since);
    if (!view.ok() || !(*view)->map().feature_cache()->status().ok()) return nullptr;
    return *std::move(view);
  }

  // Of keyframes and points that were looked at, when they are too many; who uses the view goes on with it.
  void ForgetBeyondBudget() {
    const auto& entities = view_->map().entities();
    if (entities == nullptr || entities->bytes() <= options_.entity_budget_bytes) return;
    view_ = tracking::MapView::Create(view_->map().Anew(), *view_->places());
  }

  absl::Status LoadWhole() {
    CAIRN_ASSIGN_OR_RETURN(auto places, tracking::PlaceIndex::Builder::Create(vocabulary_));
    bool all_have_words = true;
    store::LoadOptions load;
    load.feature_budget_bytes = options_.feature_budget_bytes;
    load.words = [&](KeyframeId keyframe, const std::vector<std::uint32_t>& words) {
      all_have_words = all_have_words && !words.empty();
      return places.Add(keyframe, words);
    };
    CAIRN_ASSIGN_OR_RETURN(auto snapshot, file_->LoadSnapshot(load));
    auto view = all_have_words ? ViewOf(snapshot, std::move(places)) : tracking::MapView::Create(snapshot, vocabulary_);
    CAIRN_RETURN_IF_ERROR(Annotate(view.status(), file_->uri()));
    view_ = *std::move(view);
    return absl::OkStatus();
  }

  static absl::StatusOr<std::shared_ptr<const tracking::MapView>> ViewOf(std::shared_ptr<const map::Snapshot> snapshot,
                                                                         tracking::PlaceIndex::Builder places) {
    CAIRN_ASSIGN_OR_RETURN(tracking::PlaceIndex index, std::move(places).Finish(*snapshot));
    return tracking::MapView::Create(std::move(snapshot), std::move(index));
  }

  MapReaderOptions options_;
  bool may_be_ready_ = true;
  mutable std::mutex mutex_;
  std::unique_ptr<store::MapStore> file_;
  std::shared_ptr<const place::Vocabulary> vocabulary_;
  std::shared_ptr<const tracking::MapView> view_;  // the newest that was read
};

absl::StatusOr<std::unique_ptr<MapReader>> MapReader::Open(const std::string& path, const MapReaderOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<File> file, File::Open(path, options));
  std::shared_ptr<const tracking::MapView> view = file->view();
  return std::unique_ptr<MapReader>(new MapReader(std::move(file), std::move(view)));
}

absl::StatusOr<std::unique_ptr<MapReader>> MapReader::OpenFrom(const std::string& path,
                                                               std::shared_ptr<const tracking::MapView> known) {
  CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<File> file, File::OpenFrom(path, std::move(known)));
  std::shared_ptr<const tracking::MapView> view = file->view();
  return std::unique_ptr<MapReader>(new MapReader(std::move(file), std::move(view)));
}

std::unique_ptr<ViewSource> MapReader::Another() const {
  return std::unique_ptr<ViewSource>(new MapReader(file_, view_));
}

absl::StatusOr<bool> MapReader::Refresh() {
  CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<const tracking::MapView> newest, file_->Newest());
  if (newest == view_) return false;
  view_ = std::move(newest);
  return true;
}

absl::StatusOr<store::MapSummary> MapReader::ReadSummary() { return file_->ReadSummary(); }

}  // namespace cairn::client

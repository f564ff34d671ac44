#include "cli/loaded_map.h"

#include "cli/input_options.h"
#include "health/map_vocabulary.h"

namespace cairn::cli {

namespace {

// Null: there is none, or it does not make a map.
std::shared_ptr<const map::Snapshot> ReadyMapOf(store::MapStore& file) {
  const auto ready = file.LoadReady({});
  if (!ready.ok() || !*ready) return nullptr;
  if (!(*ready)->since) return (*ready)->map;
  const auto newest = (*ready)->map->Apply(*(*ready)->since);
  return newest.ok() ? *newest : nullptr;
}

}  // namespace

absl::Status RequireKeyframes(const std::string& name, const map::Snapshot& map) {
  if (!map.keyframes().empty()) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrCat(name, " has no keyframes (cairn run --extend maps into it)"));
}

absl::Status LookInto(store::MapStore& file, bool few, const std::function<absl::Status(const map::Snapshot&)>& look) {
  if (const auto ready = few ? ReadyMapOf(file) : nullptr; ready != nullptr) {
    const absl::Status looked = look(*ready);
    if (ready->feature_cache()->status().ok()) return looked;
  }
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const map::Snapshot> map, file.LoadSnapshot());
  return look(*map);
}

absl::StatusOr<LoadedMap> LoadMap(const std::string& verb, const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> store,
                         store::OpenMapStore(path, store::OpenMode::kRead));
  LoadedMap loaded;
  CAIRN_ASSIGN_OR_RETURN(loaded.map, store->LoadSnapshot());
  std::vector<std::string> notes = store->notes();
  if (loaded.map->info().vocabulary_hash != 0) {
    CAIRN_ASSIGN_OR_RETURN(health::MapVocabulary vocabulary, health::LoadVocabulary(*store));
    loaded.words = std::move(vocabulary.words);
    if (!vocabulary.note.empty()) notes.push_back(std::move(vocabulary.note));
  }
  TellNotes(verb, notes);
  return loaded;
}

}  // namespace cairn::cli

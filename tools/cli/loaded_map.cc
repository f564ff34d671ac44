#include "cli/loaded_map.h"

#include "cli/input_options.h"
#include "health/map_vocabulary.h"
#include "store/map_store.h"

namespace cairn::cli {

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

#include "health/map_vocabulary.h"

#include <utility>

#include "place/default_vocabulary.h"

namespace cairn::health {
namespace {

absl::StatusOr<MapVocabulary> Stored(store::MapStore& store) {
  const absl::StatusOr<std::string> bytes = store.LoadVocabulary();
  if (absl::IsNotFound(bytes.status()) && store::FaultOf(bytes.status()) == store::Fault::kNone) return MapVocabulary();
  CAIRN_RETURN_IF_ERROR(bytes.status());
  absl::StatusOr<place::Vocabulary> parsed = place::Vocabulary::Parse(*bytes);
  if (!parsed.ok()) {
    return store::MakeFault(store::Fault::kDamaged,
                            absl::StrCat(store.uri(), ": vocabulary: ", parsed.status().message()));
  }
  return MapVocabulary{std::make_shared<const place::Vocabulary>(*std::move(parsed)), ""};
}

}  // namespace

absl::StatusOr<MapVocabulary> LoadVocabulary(store::MapStore& store) {
  absl::StatusOr<MapVocabulary> stored = Stored(store);
  if (stored.ok() && stored->words != nullptr) return stored;
  if (!stored.ok() && !store::IsDamaged(stored.status())) return stored;
  if (!store.exists()) return stored;
  CAIRN_ASSIGN_OR_RETURN(const store::MapSummary summary, store.ReadSummary());
  if (summary.info.vocabulary_hash == 0) return stored;
  absl::StatusOr<place::Vocabulary> shipped = place::LoadDefaultVocabulary();
  const bool same = shipped.ok() && shipped->hash() == summary.info.vocabulary_hash;
  if (!same && stored.ok()) {
    return store::MakeFault(store::Fault::kDamaged, absl::StrCat(store.uri(), ": the vocabulary is missing"));
  }
  if (!same) return stored;
  return MapVocabulary{std::make_shared<const place::Vocabulary>(*std::move(shipped)),
                       absl::StrCat(store.uri(), ": the vocabulary in the map is ", stored.ok() ? "missing" : "damaged",
                                    "; the one that ships with Cairn is the same, and is used instead. 'cairn recover' "
                                    "makes a map that has it again")};
}

}  // namespace cairn::health

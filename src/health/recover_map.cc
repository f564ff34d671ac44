#include "health/recover_map.h"

#include "place/default_vocabulary.h"

namespace cairn::health {

absl::StatusOr<store::RecoverReport> RecoverMap(const std::string& bad, const std::string& good) {
  store::RecoverOptions options;
  if (const auto shipped = place::LoadDefaultVocabulary(); shipped.ok()) {
    options.vocabulary = shipped->Serialize();
    options.vocabulary_hash = shipped->hash();
  }
  return store::RecoverMap(bad, good, options);
}

}  // namespace cairn::health

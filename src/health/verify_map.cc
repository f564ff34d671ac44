#include "health/verify_map.h"

#include <utility>

#include "health/map_vocabulary.h"
#include "map/plausibility.h"

namespace cairn::health {
namespace {

// Features, most of a map, go by keyframe for keyframe.
constexpr std::size_t kFeatureBytes = 16 << 20;

// The words that a keyframe has are those that its descriptors fall into; all of one map were looked up alike.
void CheckWords(const map::Keyframe& keyframe, const place::Vocabulary& vocabulary, VerifyReport* report) {
  const auto features = keyframe.features.Get();
  const std::vector<std::uint32_t>& words = features->words;
  if (words.empty()) return;
  const std::vector<place::WordId> expected = vocabulary.LookupAll(features->features.descriptors);
  std::size_t wrong = 0;
  for (std::size_t i = 0; i < words.size(); ++i) wrong += words[i] != expected[i] ? 1 : 0;
  report->checked_words += static_cast<std::int64_t>(words.size());
  if (wrong == 0) return;
  report->findings.push_back({"keyframe_features", keyframe.id.value(),
                              absl::StrCat("words: ", wrong, " of ", words.size(),
                                           " are not those that the vocabulary gives its descriptors")});
}

// Of a store that has been verified: what is ready to be queried says what the tables say, and need not be loaded.
absl::StatusOr<std::shared_ptr<const map::Snapshot>> Load(store::MapStore& store) {
  CAIRN_ASSIGN_OR_RETURN(const auto ready, store.LoadReady({.feature_budget_bytes = kFeatureBytes}));
  if (ready && !ready->since) return ready->map;
  store::LoadOptions load;
  load.feature_budget_bytes = kFeatureBytes;
  return store.LoadSnapshot(load);
}

absl::Status VerifyDeeply(store::MapStore& store, VerifyReport* report) {
  CAIRN_ASSIGN_OR_RETURN(const auto map, Load(store));
  const map::PlausibilityOptions options;
  CAIRN_RETURN_IF_ERROR(map::FindImplausible(*map, options, [&](map::Implausibility&& what) {
    report->findings.push_back({std::move(what.kind), what.id, std::move(what.message)});
  }));
  const auto all_read = [&] {
    return map->feature_cache() == nullptr ? absl::OkStatus() : map->feature_cache()->status();
  };
  CAIRN_RETURN_IF_ERROR(all_read());
  CAIRN_ASSIGN_OR_RETURN(const MapVocabulary vocabulary, LoadVocabulary(store));
  if (vocabulary.words == nullptr) return absl::OkStatus();
  if (vocabulary.words->hash() != map->info().vocabulary_hash) {
    report->findings.push_back({"vocabulary", 1, "it is another one than the map was made with"});
    return absl::OkStatus();
  }
  map::ForEachKeyframe(*map, options.source_bytes, [&](const map::Snapshot&, const map::Keyframe& keyframe) {
    CheckWords(keyframe, *vocabulary.words, report);
  });
  return all_read();
}

}  // namespace

absl::Status CheckSound(const std::string& uri) {
  CAIRN_ASSIGN_OR_RETURN(const auto store, store::OpenMapStore(uri, store::OpenMode::kRead));
  CAIRN_ASSIGN_OR_RETURN(const std::vector<store::Finding> findings, store->Verify());
  return Annotate(store::StatusOf(findings), absl::StrCat("map ", uri));
}

absl::StatusOr<VerifyReport> VerifyMap(const std::string& uri, const VerifyOptions& options) {
  VerifyReport report;
  // Damage ends a check, and is what was looked for.
  const auto absorb = [&](const absl::Status& status) {
    if (!store::IsDamaged(status)) return status;
    report.findings.push_back({"", 0, std::string(status.message())});
    return absl::OkStatus();
  };
  auto store = store::OpenMapStore(uri, store::OpenMode::kRead);
  if (!store.ok()) {
    CAIRN_RETURN_IF_ERROR(absorb(store.status()));
    return report;
  }
  report.notes = (*store)->notes();
  const auto summary = (*store)->ReadSummary();
  if (summary.ok()) report.summary = *summary;
  CAIRN_ASSIGN_OR_RETURN(report.findings, (*store)->Verify());
  if (report.findings.empty()) CAIRN_RETURN_IF_ERROR(absorb(summary.status()));
  if (report.findings.empty() && options.deep) CAIRN_RETURN_IF_ERROR(absorb(VerifyDeeply(**store, &report)));
  return report;
}

}  // namespace cairn::health

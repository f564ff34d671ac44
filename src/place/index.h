// Inverted index over bags of words, keyed by opaque ids, and matching guided by the direct index (Galvez-Lopez &
// Tardos, T-RO 2012, sec. IV-V).
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <unordered_map>
#include <vector>

#include "base/status.h"
#include "image/feature.h"
#include "image/matching.h"
#include "place/vocabulary.h"

namespace cairn::place {

struct QueryOptions {
  // Candidates must share at least this part of the largest number of words shared with any entry (Mur-Artal, Tardos:
  // "Fast relocalisation and loop closing in keyframe-based SLAM", ICRA 2014). 0: one shared word is enough.
  double min_common_share = 0.8;
  double min_score = 0.0;
  std::size_t max_results = 10;                // 0: all
  std::function<bool(std::uint32_t)> exclude;  // true: ignore this id, also for the largest number above

  absl::Status Validate() const;
};

struct Candidate {
  std::uint32_t id = 0;
  double score = 0.0;              // L1 score in [0, 1]
  std::uint32_t common_words = 0;  // words in both

  bool operator==(const Candidate&) const = default;
};

// Add and Remove need exclusive access; const calls may run concurrently.
class InvertedIndex {
 public:
  // For words 0 .. num_words-1.
  explicit InvertedIndex(std::size_t num_words) : postings_(num_words) {}

  // AlreadyExists if the id is there; InvalidArgument for a word out of range or words not sorted.
  absl::Status Add(std::uint32_t id, BowVector words);
  // NotFound if the id is not there.
  absl::Status Remove(std::uint32_t id);

  bool Contains(std::uint32_t id) const { return slot_of_id_.contains(id); }
  std::size_t size() const { return slot_of_id_.size(); }

  // Best score first; of equal scores the smaller id. The answer does not depend on the order of Add and Remove calls.
  std::vector<Candidate> Query(const BowVector& words, const QueryOptions& options = {}) const;

 private:
  struct Posting {
    std::uint32_t slot;
    float weight;
  };
  struct Entry {
    std::uint32_t id = 0;
    bool used = false;
    BowVector words;
  };
  std::vector<std::vector<Posting>> postings_;  // by word
  std::vector<Entry> entries_;                  // by slot; freed slots are reused
  std::vector<std::uint32_t> free_slots_;
  std::unordered_map<std::uint32_t, std::uint32_t> slot_of_id_;
};

// Compares only features under the same node of the vocabulary. Both direct indices must come from the same vocabulary
// and level. A mask, if not empty, has an entry per feature; features with 0 are left out. Sorted by feature of a.
std::vector<image::FeatureMatch> MatchByWords(const image::Features& a, const DirectIndex& direct_a,
                                              const image::Features& b, const DirectIndex& direct_b,
                                              const image::MatchOptions& options = {},
                                              std::span<const std::uint8_t> mask_a = {},
                                              std::span<const std::uint8_t> mask_b = {});

}  // namespace cairn::place

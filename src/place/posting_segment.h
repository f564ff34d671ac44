// The words of many images, by word: two bytes for each word of an image, which image and how often. What a word weighs
// there follows from that (place/weighing.h). Never changes.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "base/status.h"
#include "place/vocabulary.h"
#include "place/weighing.h"

namespace cairn::place {

class PostingSegment {
 public:
  static constexpr std::uint32_t kMaxEntries = 1u << 10;

  // The words of entries `first`, `first` + 1, ... (at most kMaxEntries), each below idf.size(), in any order.
  PostingSegment(std::uint32_t first, std::span<const std::span<const WordId>> words_of_entry,
                 std::span<const float> idf);

  // As bytes, to be kept (docs/map-format.md, "Place index"): half of what it takes in memory. Little-endian.
  std::string Pack() const;
  // The same with its entries from `first` on, for a vocabulary of so many words. DataLoss if that is not what the
  // bytes hold; no bytes lead beyond it.
  static absl::StatusOr<PostingSegment> Unpack(std::uint32_t first, std::size_t num_words, std::string_view bytes);

  std::uint32_t first() const { return first_; }
  std::uint32_t num_entries() const { return static_cast<std::uint32_t>(sum_.size()); }

  // Calls visit(entry, weight) for every entry with the word, which weighs `idf` in all of them.
  template <class Visit>
  void ForEach(WordId word, float idf, Visit&& visit) const {
    ForEachCount(word, [&](std::uint32_t entry, std::uint32_t count) {
      visit(entry, NormalizedWeight(count, idf, sum_[entry - first_]));
    });
  }
  // Likewise visit(entry, count): how often it has the word.
  template <class Visit>
  void ForEachCount(WordId word, Visit&& visit) const {
    for (std::uint32_t i = begin_[word]; i < begin_[word + std::size_t{1}]; ++i) {
      std::uint32_t count = postings_[i] >> kEntryBits;
      if (count == kMany) count = many_.at(i);
      visit(first_ + (postings_[i] & kEntryMask), count);
    }
  }

 private:
  PostingSegment() = default;

  static constexpr int kEntryBits = 10;
  static constexpr std::uint32_t kEntryMask = kMaxEntries - 1;
  static constexpr std::uint32_t kMany = (1u << (16 - kEntryBits)) - 1;  // as often, or more
  static_assert(kMaxEntries == 1u << kEntryBits);

  std::uint32_t first_ = 0;
  std::vector<std::uint32_t> begin_;                       // in `postings_`, by word; and the end
  std::vector<std::uint16_t> postings_;                    // of each word ascending: entry, and above it the count
  std::unordered_map<std::uint32_t, std::uint32_t> many_;  // counts of postings that say kMany
  std::vector<double> sum_;                                // of term weights, by entry
};

}  // namespace cairn::place

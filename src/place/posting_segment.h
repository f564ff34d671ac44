// The words of many images, by word: two bytes for each word of an image, which image and how often. What a word weighs
// there follows from that (place/weighing.h). Never changes.
#pragma once

#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include "place/vocabulary.h"
#include "place/weighing.h"

namespace cairn::place {

class PostingSegment {
 public:
  static constexpr std::uint32_t kMaxEntries = 1u << 10;

  // The words of entries `first`, `first` + 1, ... (at most kMaxEntries), each below idf.size(), in any order.
  PostingSegment(std::uint32_t first, std::span<const std::span<const WordId>> words_of_entry,
                 std::span<const float> idf);

  std::uint32_t first() const { return first_; }

  // Calls visit(entry, weight) for every entry with the word, which weighs `idf` in all of them.
  template <class Visit>
  void ForEach(WordId word, float idf, Visit&& visit) const {
    for (std::uint32_t i = begin_[word]; i < begin_[word + std::size_t{1}]; ++i) {
      const std::uint32_t entry = postings_[i] & kEntryMask;
      std::uint32_t count = postings_[i] >> kEntryBits;
      if (count == kMany) count = many_.at(i);
      visit(first_ + entry, NormalizedWeight(count, idf, sum_[entry]));
    }
  }

 private:
  static constexpr int kEntryBits = 10;
  static constexpr std::uint32_t kEntryMask = kMaxEntries - 1;
  static constexpr std::uint32_t kMany = (1u << (16 - kEntryBits)) - 1;  // as often, or more
  static_assert(kMaxEntries == 1u << kEntryBits);

  std::uint32_t first_;
  std::vector<std::uint32_t> begin_;                       // in `postings_`, by word; and the end
  std::vector<std::uint16_t> postings_;                    // of each word ascending: entry, and above it the count
  std::unordered_map<std::uint32_t, std::uint32_t> many_;  // counts of postings that say kMany
  std::vector<double> sum_;                                // of term weights, by entry
};

}  // namespace cairn::place

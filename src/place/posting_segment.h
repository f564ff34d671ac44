// The words of many images, by word: a byte for most words of an image, which image and how often. What a word weighs
// there follows from that (place/weighing.h). Never changes.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/shared_bytes.h"
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

  // As bytes, to be kept (docs/map-format.md, "Place index"): they are what it has in memory. Little-endian.
  std::string Pack() const { return std::string(bytes_.view()); }
  // The same with its entries from `first` on, for a vocabulary of so many words; it keeps the bytes. DataLoss if that
  // is not what they hold; no bytes lead beyond it.
  static absl::StatusOr<PostingSegment> Unpack(std::uint32_t first, std::size_t num_words, SharedBytes bytes);

  // In how many entries each word is; once, as they are not kept.
  std::vector<std::uint16_t> TakeFrequencies() { return std::exchange(frequencies_, {}); }

  std::uint32_t first() const { return first_; }
  std::uint32_t num_entries() const { return static_cast<std::uint32_t>(inverse_sum_.size()); }

  // Calls visit(entry, weight) for every entry with the word, which weighs `idf` in all of them.
  template <class Visit>
  void ForEach(WordId word, float idf, Visit&& visit) const {
    ForEachCount(word, [&](std::uint32_t entry, std::uint32_t count) {
      visit(entry, NormalizedWeight(count, idf, inverse_sum_[entry - first_]));
    });
  }
  // The same for many words, ascending: calls visit(word, entry, weight) in their order. What a word needs lies
  // anywhere in the segment, and is fetched while the words before it are read.
  template <class Visit>
  void ForAll(std::span<const WeightedWord> words, std::span<const float> idf, Visit&& visit) const {
    constexpr std::size_t kAhead = 16;
    for (std::size_t i = 0; i < words.size() && words[i].word < places_.size(); ++i) {
      if (i + 2 * kAhead < words.size()) FetchPlace(words[i + 2 * kAhead].word);
      if (i + kAhead < words.size()) FetchPostings(words[i + kAhead].word);
      const WeightedWord& word = words[i];
      ForEach(word.word, idf[word.word], [&](std::uint32_t entry, float weight) { visit(word, entry, weight); });
    }
  }
  // Likewise visit(entry, count): how often it has the word. Most have it once, of which nothing is looked up.
  template <class Visit>
  void ForEachCount(WordId word, Visit&& visit) const {
    const std::uint32_t end = EndOf(word), num_entries = this->num_entries();
    const auto* const bytes = reinterpret_cast<const std::uint8_t*>(bytes_.view().data());
    std::uint32_t at = BeginOf(word), entry = 0;
    const auto next = [&] {  // whether it is an entry
      std::uint32_t gap = bytes[at++];
      if (gap == kFar) gap = VarintFrom(&at);
      entry += gap;
      return entry < num_entries;
    };
    const Place& place = places_[word];
    std::uint32_t more = place.more, once = place.first_more == kNone ? ~std::uint32_t{0} : place.first_more;
    while (true) {
      for (; once > 0 && at < end; --once, ++entry) {
        if (!next()) return;
        visit(first_ + entry, 1);
      }
      if (at >= end || !next()) return;
      const std::uint32_t count = VarintFrom(&more);
      once = VarintFrom(&more);  // leads to another word's, if this has no more
      visit(first_ + entry++, count);
    }
  }

 private:
  PostingSegment() = default;

  // Instead of how many entries were passed over, if they are so many or more: then the number follows.
  static constexpr std::uint8_t kFar = 255;
  // Of a word's postings, so many lines of the cache are fetched ahead; the processor finds those behind them.
  static constexpr std::uint32_t kFetchedLines = 4, kLine = 64;
  // So many words share a number of where their postings begin.
  static constexpr std::uint32_t kWordsPerBlock = 16;
  static constexpr std::uint16_t kNone = 0xffff;
  // Of a word.
  struct Place {
    std::uint32_t more;                // in `bytes_`, how often that entry has it; those that follow come behind it
    std::uint16_t first_more = kNone;  // the first of its postings whose entry has it more than once
    std::uint16_t gaps;                // where its postings begin, from its block's on
  };

  // Reads a number and goes on behind it; the greatest beyond the end.
  std::uint32_t VarintAt(std::uint32_t* at) const;
  // The same for a variable of a loop, which stays in a register as nobody else is told where it is.
  std::uint32_t VarintFrom(std::uint32_t* at) const {
    if (*at < bytes_.view().size()) {
      const auto byte = static_cast<std::uint8_t>(bytes_.view()[*at]);
      if (byte < 0x80) {  // most
        ++*at;
        return byte;
      }
    }
    std::uint32_t from = *at;
    const std::uint32_t value = VarintAt(&from);
    *at = from;
    return value;
  }
  std::uint32_t BeginOf(WordId word) const { return blocks_[word / kWordsPerBlock] + places_[word].gaps; }
  std::uint32_t EndOf(WordId word) const {
    const bool last = word + std::size_t{1} == places_.size() || (word + 1) % kWordsPerBlock == 0;
    return last ? blocks_[word / kWordsPerBlock + 1] : BeginOf(word + 1);
  }
  void FetchPlace(WordId word) const {
    if (word >= places_.size()) return;
    __builtin_prefetch(&blocks_[word / kWordsPerBlock]);
    __builtin_prefetch(&places_[word]);
  }
  void FetchPostings(WordId word) const {
    if (word >= places_.size()) return;
    const std::uint32_t begin = BeginOf(word), end = EndOf(word);
    for (std::uint32_t line = 0; line < kFetchedLines && begin + kLine * line < end; ++line) {
      __builtin_prefetch(bytes_.view().data() + begin + kLine * line);
    }
    if (places_[word].first_more != kNone) __builtin_prefetch(bytes_.view().data() + places_[word].more);
  }
  class Packing;
  // Finds its way in `bytes_`, and checks them.
  absl::Status Index(std::size_t num_words);
  absl::Status IndexGaps(std::size_t* at);
  absl::Status IndexMore(std::uint32_t num_postings, std::size_t at);

  std::uint32_t first_ = 0;
  SharedBytes bytes_;                  // as they are packed
  std::vector<float> inverse_sum_;     // 1 over the sum of term weights, by entry
  std::vector<std::uint32_t> blocks_;  // in `bytes_`, where the postings of the first of their words begin; and the end
  std::vector<Place> places_;          // by word
  std::vector<std::uint16_t> frequencies_;
};

}  // namespace cairn::place

// The words of many images, by word: a byte for most words of an image, which image and how often. What a word weighs
// there follows from that (place/weighing.h). Never changes.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
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

  // As bytes, to be kept (docs/map-format.md, "Place index"): they are what it has in memory. Little-endian.
  const std::string& Pack() const { return bytes_; }
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
  // The same for many words, ascending: calls visit(word, entry, weight) in their order. What a word needs lies
  // anywhere in the segment, and is fetched while the words before it are read.
  template <class Visit>
  void ForAll(std::span<const WeightedWord> words, std::span<const float> idf, Visit&& visit) const {
    constexpr std::size_t kAhead = 8;
    for (std::size_t i = 0; i < words.size() && words[i].word < within_.size(); ++i) {
      if (i + 2 * kAhead < words.size()) FetchPlace(words[i + 2 * kAhead].word);
      if (i + kAhead < words.size()) FetchPostings(words[i + kAhead].word);
      const WeightedWord& word = words[i];
      ForEach(word.word, idf[word.word], [&](std::uint32_t entry, float weight) { visit(word, entry, weight); });
    }
  }
  // Likewise visit(entry, count): how often it has the word.
  template <class Visit>
  void ForEachCount(WordId word, Visit&& visit) const {
    std::array<Posting, kMaxEntries> postings;
    const std::size_t count = Read(word, postings.data());
    for (std::size_t i = 0; i < count; ++i) visit(first_ + postings[i].entry, postings[i].count);
  }

 private:
  PostingSegment() = default;

  struct Posting {
    std::uint32_t entry, count;
  };
  // So many words share one of these: where what is said of the first of them begins.
  static constexpr std::uint32_t kWordsPerBlock = 16;
  struct Block {
    std::uint32_t gaps;       // in `bytes_`
    std::uint32_t posting;    // number of its first posting
    std::uint32_t more;       // in `bytes_`, where words follow that are there more than once
    std::uint32_t more_from;  // the number that the first of these counts from
  };
  // Where a word begins, from what its block says on.
  struct Within {
    std::uint16_t gaps, posting;
  };

  void FetchPlace(WordId word) const {
    if (word >= within_.size()) return;
    __builtin_prefetch(&blocks_[word / kWordsPerBlock]);
    __builtin_prefetch(&within_[word]);
  }
  void FetchPostings(WordId word) const {
    if (word < within_.size())
      __builtin_prefetch(bytes_.data() + blocks_[word / kWordsPerBlock].gaps + within_[word].gaps);
  }
  // Finds its way in `bytes_`, and checks them.
  absl::Status Index(std::size_t num_words);
  absl::Status IndexGaps(const std::vector<std::uint16_t>& counts, std::size_t* at);
  absl::Status IndexMore(std::uint32_t num_postings, std::size_t at);
  // The postings of a word, of which there are at most kMaxEntries, into `out`; gives their number.
  std::size_t Read(WordId word, Posting* out) const;

  std::uint32_t first_ = 0;
  std::string bytes_;           // as they are packed
  std::vector<double> sum_;     // of term weights, by entry
  std::vector<Block> blocks_;   // and the end
  std::vector<Within> within_;  // by word
};

}  // namespace cairn::place

#include "place/posting_segment.h"

#include <algorithm>
#include <array>
#include <utility>

namespace cairn::place {

PostingSegment::PostingSegment(std::uint32_t first, std::span<const std::span<const WordId>> words_of_entry,
                               std::span<const float> idf)
    : first_(first), begin_(idf.size() + 1), sum_(words_of_entry.size(), 0.0) {
  // Sorted by word in two passes that each write to few places at once, by the upper bits and then by the lower ones.
  // Entries stay in their order, so that a word that an entry has several times is in one run.
  constexpr int kLowBits = 9;
  constexpr std::uint32_t kLows = 1u << kLowBits;
  std::vector<std::uint32_t> bucket(idf.size() / kLows + 2, 0);  // begins, once they are summed
  for (const std::span<const WordId> words : words_of_entry) {
    for (const WordId word : words) ++bucket[word / kLows + 1];
  }
  for (std::size_t i = 1; i < bucket.size(); ++i) bucket[i] += bucket[i - 1];
  std::vector<std::uint32_t> by_bucket(bucket.back());  // the lower bits of the word above those of the entry
  {
    std::vector<std::uint32_t> next = bucket;
    for (std::uint32_t entry = 0; entry < words_of_entry.size(); ++entry) {
      for (const WordId word : words_of_entry[entry]) {
        by_bucket[next[word / kLows]++] = (word % kLows) << kEntryBits | entry;
      }
    }
  }

  postings_.reserve(by_bucket.size());
  std::vector<std::uint16_t> sorted;
  for (std::size_t b = 0; b + 1 < bucket.size(); ++b) {
    const std::span<const std::uint32_t> items(by_bucket.data() + bucket[b], bucket[b + 1] - bucket[b]);
    std::array<std::uint32_t, kLows> end{};  // begins, until all items are sorted
    for (const std::uint32_t item : items) ++end[item >> kEntryBits];
    std::uint32_t total = 0;
    for (std::uint32_t& count : end) total += std::exchange(count, total);
    sorted.resize(items.size());
    for (const std::uint32_t item : items) {
      sorted[end[item >> kEntryBits]++] = static_cast<std::uint16_t>(item & kEntryMask);
    }
    std::uint32_t i = 0;
    for (std::uint32_t low = 0; low < kLows && b * kLows + low < idf.size(); ++low) {
      const std::size_t word = b * kLows + low;
      begin_[word] = static_cast<std::uint32_t>(postings_.size());
      while (i < end[low]) {
        const std::uint16_t entry = sorted[i];
        std::uint32_t count = 0;
        for (; i < end[low] && sorted[i] == entry; ++i) ++count;
        sum_[entry] += TermWeight(count, idf[word]);
        if (!(TermWeight(count, idf[word]) > 0.0)) continue;
        if (count >= kMany) many_.emplace(static_cast<std::uint32_t>(postings_.size()), count);
        postings_.push_back(static_cast<std::uint16_t>(std::min(count, kMany) << kEntryBits | entry));
      }
    }
  }
  begin_.back() = static_cast<std::uint32_t>(postings_.size());
  postings_.shrink_to_fit();
}

}  // namespace cairn::place

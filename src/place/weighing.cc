#include "place/weighing.h"

#include <array>
#include <utility>

namespace cairn::place {
namespace {

// Words below `num_words`; of an image's thousands a radix sort takes a tenth of the time of std::sort.
void SortWords(std::vector<WordId>* words, std::size_t num_words) {
  constexpr int kBits = 9;
  constexpr std::size_t kBuckets = std::size_t{1} << kBits;
  std::vector<WordId> other(words->size());
  for (int shift = 0; (num_words >> shift) != 0; shift += kBits) {
    std::array<std::uint32_t, kBuckets> end{};
    for (const WordId word : *words) ++end[(word >> shift) & (kBuckets - 1)];
    std::uint32_t sum = 0;
    for (std::uint32_t& bucket : end) sum += std::exchange(bucket, sum);
    for (const WordId word : *words) other[end[(word >> shift) & (kBuckets - 1)]++] = word;
    words->swap(other);
  }
}

}  // namespace

BowVector Weigh(std::vector<WordId> words, std::span<const float> idf) {
  SortWords(&words, idf.size());
  struct Counted {
    WordId word;
    std::uint32_t count;
  };
  std::vector<Counted> counted;
  counted.reserve(words.size());
  double sum = 0.0;
  for (std::size_t i = 0; i < words.size();) {
    std::size_t end = i;
    while (end < words.size() && words[end] == words[i]) ++end;
    const auto count = static_cast<std::uint32_t>(end - i);
    sum += TermWeight(count, idf[words[i]]);
    if (TermWeight(count, idf[words[i]]) > 0.0) counted.push_back({words[i], count});
    i = end;
  }
  const auto inverse_sum = static_cast<float>(1.0 / sum);
  BowVector bow;
  bow.reserve(counted.size());
  for (const Counted& entry : counted) {
    bow.push_back({entry.word, NormalizedWeight(entry.count, idf[entry.word], inverse_sum)});
  }
  return bow;
}

}  // namespace cairn::place
